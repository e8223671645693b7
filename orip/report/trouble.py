"""What is wrong or weak, in the user's names: suspicious observations with their probable sizes."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from orip.arrays import BoolArray, FloatArray, IntArray
from orip.bundle.results.reliability import FAMILY_ALPHA, suspect_rows
from orip.records.coded_names import coded
from orip.records.observation_kinds import named_observation, unit_of_observation
from orip.records.results.solution import Blunder, Residuals, Solution
from orip.report.report_input import ReportInput, pixel_of_photo
from orip.report.table import NO_LINKS, SINGULAR, PageColumn, PageTable, counted, decimals_of_most, fixed, significant
from orip.structs import remembered
from orip.wording import first_names


def suspects(solution: Solution, test_level: float | None = None) -> dict[str, list[str]]:
    """Return the observations that do not fit, the worst first, with the probable size of each component's error."""
    found: dict[str, list[str]] = {}
    for row in suspect_rows(solution, test_level).tolist():
        size, component = probable_size(solution.residuals, row), solution.residuals.component[row]
        unit = "" if size == SINGULAR else unit_of_residual(solution, row)
        name = observation_of(solution.residuals, row)
        text = f"{size} {unit}" if name.startswith(f"{component} of ") else f"{component} {size} {unit}"
        found.setdefault(name, []).append(text.strip())
    return found


_TESTABLE = 1e-4
"""Redundancy number above which the size of an error shows: control that is much better than the photos has little."""


def observation_of(residuals: Residuals, row: int) -> str:
    """Return what an observation is called: ``photo 101 point 12``."""
    return named_observation(residuals.kind[row], residuals.photo[row], residuals.point[row], residuals.component[row])


def probable_error(residuals: Residuals, row: int) -> float:
    """Return by how much an observation is probably off: observed minus what all others predict; NaN if not tested."""
    number = residuals.redundancy_number[row]
    return float(-residuals.residual[row] / number) if number > _TESTABLE else math.nan


def probable_size(residuals: Residuals, row: int) -> str:
    """Return the same as text."""
    error = probable_error(residuals, row)
    return SINGULAR if math.isnan(error) else fixed(error, decimals_of_most([residuals.a_priori[row]]))


def unit_of_residual(solution: Solution, row: int) -> str:
    """Return the unit of a residual."""
    residuals = solution.residuals
    return unit_of_observation(residuals.kind[row], residuals.component[row], solution.ground_unit)


MOST_SUSPECTS = 40
MOST_WEAK = 20
_SUSPECTS_ON_PAPER, _WEAK_ON_PAPER = 25, 12
UNCHECKED = 0.10
"""Redundancy number below which an error is hidden: less than a tenth of it shows in its own residual."""

_FAR_WORSE = 3.0
_MOST_BY_HAND = 60
"""Points with the same weakness that anybody would measure again; of more a program has to match more."""
_NAMED = 12


def blunder_table(given: ReportInput) -> PageTable | None:
    """Return the blunders that data snooping found and left out."""
    solution = given.solution
    found = solution.blunders
    if not found:
        return None
    names = [named_observation(blunder.kind, blunder.photo, blunder.point, blunder.component) for blunder in found]
    links = {name: given.place(blunder.photo, blunder.point) for name, blunder in zip(names, found, strict=True)}
    others = [blunder.alternatives for blunder in found]
    columns = (
        PageColumn("No.", [str(blunder.order) for blunder in found], key="order"),
        PageColumn("Observation", names, words=True, links=links),
        PageColumn("Component", [blunder.component for blunder in found], key="component", words=True),
        PageColumn("Size", [fixed(blunder.size, decimals_of_most([blunder.sd])) for blunder in found], key="size"),
        PageColumn("sd", [significant(blunder.sd, 2) for blunder in found], key="sd"),
        PageColumn("Unit", [_unit_of_blunder(blunder, solution) for blunder in found], words=True),
        PageColumn("Test", [significant(blunder.statistic) for blunder in found], key="statistic"),
        PageColumn("Limit", [significant(blunder.limit) for blunder in found], key="limit"),
        *([PageColumn("Cannot be told apart from", others, words=True)] if any(others) else []),
    )
    note = "Size: observed minus what all other observations predict. They have no influence on the results."
    return PageTable("blunders", "Blunders found and left out", columns, note)


def suspect_table(given: ReportInput, anchors: Mapping[str, str] = NO_LINKS) -> PageTable | None:
    """Return the observations that fit worse than chance explains, the worst first."""
    solution = given.solution
    residuals = solution.residuals
    rows = suspect_rows(solution, given.test_level)
    if not rows.size:
        return None
    down = residuals.weight_factor < 1.0
    shown = rows[:MOST_SUSPECTS]
    found = counted(len(suspects(solution, given.test_level)), "observation")
    note = (
        f"{found}, {counted(len(rows), 'component')}; {_level(given.test_level)} "
        "Probable size: observed minus what all other observations predict, −residual / redundancy number. "
        "Measure again, or disregard; check names first: a mistaken name shows as a size that fits another point. "
        + _left_out(len(rows), len(shown))
    )
    names = [observation_of(residuals, row) for row in shown]
    links = {
        name: given.place(photo, point) or anchors.get(photo, "")
        for name, photo, point in zip(
            names, _picked(residuals.photo, shown), _picked(residuals.point, shown), strict=True
        )
    }
    columns = (
        PageColumn("Observation", names, words=True, links=links),
        PageColumn("Component", _picked(residuals.component, shown), words=True),
        PageColumn("Probable size", [probable_size(residuals, row) for row in shown]),
        PageColumn("Unit", [unit_of_residual(solution, row) for row in shown], words=True),
        *_in_pixels(given, shown),
        PageColumn("Residual", [_with_precision(residuals, residuals.residual, row) for row in shown]),
        PageColumn("Standard residual", [fixed(value, 1) for value in residuals.standard_residual[shown]]),
        PageColumn("w", [fixed(value, 1) for value in residuals.w[shown]]),
        PageColumn("Weight factor", [_weight(value) for value in residuals.weight_factor[shown]]),
    )
    emphasised = frozenset(np.flatnonzero(down[shown]).tolist())
    return PageTable("", "Observations that do not fit", columns, note.strip(), emphasised, _SUSPECTS_ON_PAPER)


def worst_in_photo(given: ReportInput) -> str:
    """Return the photo point that fits least of those that do not, as `orip screen --at` takes it; empty: all fit."""
    residuals = given.solution.residuals
    rows = (row for row in suspect_rows(given.solution, given.test_level).tolist() if residuals.kind[row] == "photo")
    return next((f"{residuals.photo[row]}/{residuals.point[row]}" for row in rows), "")


def _level(test_level: float | None) -> str:
    if test_level is None:
        return f"in a block without blunders anything is listed here with a probability of {FAMILY_ALPHA:.0%} at most."
    return f"each test has an error probability of {test_level:g}: in large blocks without blunders some are listed."


def _in_pixels(given: ReportInput, rows: IntArray) -> Iterator[PageColumn]:
    """Yield the column of probable sizes in pixels, if any of these observations was measured in pixels."""
    residuals = given.solution.residuals
    pixels = np.array(
        [pixel_of_photo(given, residuals.photo[row]) if residuals.kind[row] == "photo" else np.nan for row in rows]
    )
    if np.isfinite(pixels).any():
        sizes = [probable_error(residuals, row) / pixel for row, pixel in zip(rows.tolist(), pixels, strict=True)]
        yield PageColumn("Probable size", [fixed(size, 1) for size in sizes], "px")


def singular_table(solution: Solution) -> PageTable | None:
    """Return the unknowns that nothing determines."""
    found = solution.singular
    if not found:
        return None
    columns = (
        PageColumn("Record", [f"{unknown.group.lower()} {unknown.name}" for unknown in found], words=True),
        PageColumn("Unknown", [unknown.kind for unknown in found], key="kind", words=True),
        PageColumn("Lost digits", [fixed(unknown.lost_digits, 1) for unknown in found], key="lost_digits"),
    )
    note = "They keep their preliminary values. The diagnosis says why, and what would determine them."
    return PageTable("singular", "Unknowns that nothing determines", columns, note)


def weak_table(given: ReportInput) -> PageTable | None:
    """Return what would go unnoticed or is much worse than the rest: single rays, unchecked points, large sd."""
    spots = weak_spots(given.solution)
    if not spots:
        return None
    shown = spots[:MOST_WEAK]
    where = [f"{spot.where}: {spot.names}" if spot.names else spot.where for spot in shown]
    links = {name: given.place(point=name.partition("point ")[2]) for name in where}
    columns = (
        PageColumn("Where", where, words=True, links=links),
        PageColumn("What is weak", [spot.what for spot in shown], words=True),
        PageColumn("What to do", [spot.remedy for spot in shown], words=True),
    )
    left_out = _left_out(len(spots), len(shown)).strip()
    return PageTable("", "Weak spots", columns, left_out, on_paper=_WEAK_ON_PAPER)


class Spot(NamedTuple):
    """A weak spot: where it is, what is weak, what to do, and of many the names of some."""

    where: str
    what: str
    remedy: str
    names: str = ""


@remembered
def weak_spots(solution: Solution) -> list[Spot]:
    """Return what would go unnoticed or is much worse than the rest: few rays, unchecked observations, large sd."""
    return [*_few_rays(solution), *_unchecked(solution), *_imprecise(solution)]


def _few_rays(solution: Solution) -> Iterator[Spot]:
    """Return the points with one ray and those with two, which nothing checks along their epipolar lines."""
    for number, what, by_hand, matched in (
        (
            1,
            "seen in one photo only: nothing checks them",
            "measure them in another photo, or give them control",
            "matched by a program they change nothing, and can be left out",
        ),
        (
            2,
            "seen in two photos only: an error along the epipolar line cannot be detected",
            "measure them in a third photo",
            "match between more photos, or have more overlap; what has to be sure is measured in three photos by hand",
        ),
    ):
        rows = np.flatnonzero(_without_control(solution) & (solution.point_rays == number))
        if len(rows):
            remedy = by_hand if len(rows) <= _MOST_BY_HAND else matched
            names = first_names([solution.points.names[row] for row in rows[:_NAMED].tolist()], _NAMED, len(rows))
            yield Spot(counted(len(rows), "point"), what, remedy, names)


def _without_control(solution: Solution) -> BoolArray:
    """Return which points (n,) are no control points."""
    return ~coded(solution.point_kinds).where("control".__eq__)


def _unchecked(solution: Solution) -> list[Spot]:
    """Return observations that hardly anything checks although the point has three rays, the worst first."""
    residuals, names = solution.residuals, solution.points.names
    has_few = np.zeros(len(names) + 1, dtype=bool)  # the last one: of what is no point of the solution
    rays = solution.point_rays
    has_few[:-1] = _without_control(solution) & (rays >= 1) & (rays <= 2)
    rows = np.flatnonzero(residuals.redundancy_number < UNCHECKED)  # few of millions
    rows = rows[coded(residuals.kind)[rows].where(lambda kind: kind in {"photo", "control"})]
    rows = rows[~np.isnan(residuals.weight_factor[rows])]
    point = coded(residuals.point)[rows]
    is_open = ~has_few[point.places_among(names)]
    rows, point = rows[is_open], point[is_open]
    order = np.argsort(residuals.redundancy_number[rows], kind="stable")
    # the worst row of each point, of its rays and of its control
    of_photo = coded(residuals.kind)[rows].where("photo".__eq__)
    _, first = np.unique(2 * point.codes[order].astype(np.int64) + of_photo[order], return_index=True)
    worst = order[np.sort(first)]
    rows, of_photo = rows[worst], of_photo[worst]

    def spot(row: int) -> Spot:
        in_photo = f" in photo {residuals.photo[row]}" if residuals.photo[row] else ""
        number = f"redundancy number {residuals.redundancy_number[row]:.2f}"
        what, name = f"{residuals.component[row]}{in_photo} hardly checked ({number})", residuals.point[row]
        if residuals.kind[row] == "photo":
            return Spot(f"point {name}", what, "measure it in a further photo")
        return Spot(f"control point {name}", what, "add control near it")

    control, remedy = map(spot, rows[~of_photo].tolist()), "match between more photos, or have more overlap"
    points = _one_or_each(
        rows[of_photo], coded(residuals.point)[rows[of_photo]], spot, "a coordinate hardly checked", remedy
    )
    return [*control, *points]


def _one_or_each(
    rows: IntArray, names: Sequence[str], spot: Callable[[int], Spot], what: str, remedy: str
) -> list[Spot]:
    """Return the spots of points, the worst first, or one for all where nobody measures so many by hand."""
    if len(rows) <= _MOST_BY_HAND:
        return list(map(spot, rows.tolist()))
    whole = f"{what}; the worst: {spot(int(rows[0])).what}"
    return [Spot(counted(len(rows), "point"), whole, remedy, first_names(names, _NAMED))]


def _imprecise(solution: Solution) -> list[Spot]:
    sd = np.where(np.isfinite(solution.points.sd), solution.points.sd, np.nan)
    largest = np.fmax(np.fmax(sd[:, 0], sd[:, 1]), sd[:, 2])
    known = largest[~np.isnan(largest)]
    if not known.size:
        return []
    typical = float(np.median(known))
    rows = np.flatnonzero(largest > _FAR_WORSE * typical)
    rows = rows[np.argsort(-largest[rows], kind="stable")]
    decimals = decimals_of_most([typical])

    def spot(row: int) -> Spot:
        size, axis = float(largest[row]), "XYZ"[int(np.nanargmax(sd[row]))]
        shown = f"sd {fixed(size, decimals)} {solution.ground_unit} in {axis}"
        what = f"{shown}, {significant(size / typical, 2)} times the median; {solution.point_rays[row]} rays"
        return Spot(f"point {solution.points.names[row]}", what, "measure it in photos taken from further apart")

    names, remedy = _picked(solution.points.names, rows), "match between photos taken from further apart"
    return _one_or_each(rows, names, spot, "much less precise than the median", remedy)


def _picked(names: Sequence[str], rows: IntArray) -> list[str]:
    return [names[row] for row in rows]


def _with_precision(residuals: Residuals, values: FloatArray, row: int) -> str:
    return fixed(float(values[row]), decimals_of_most([residuals.a_priori[row]]))


def _unit_of_blunder(blunder: Blunder, solution: Solution) -> str:
    return unit_of_observation(blunder.kind, blunder.component, solution.ground_unit)


def _weight(value: float) -> str:
    return "1" if value == 1.0 else f"{value:.2g}"


def _left_out(found: int, shown: int) -> str:
    return f"The {shown} worst of {found} are shown." if shown < found else ""
