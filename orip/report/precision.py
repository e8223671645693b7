"""Precision on the page: standard deviations, estimated a-priori errors, and how the iterations went."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from markupsafe import Markup
from msgspec import Struct

from orip.arrays import IntArray
from orip.bundle.results.reliability import suspect_rows
from orip.records.coded_names import coded
from orip.records.names import places_of_names
from orip.records.observation_kinds import places_of_measured, point_of_measurement, unit_of_unknown
from orip.records.photo import PHOTO_PARAMETERS
from orip.records.results.solution import AntennaEstimate, Correlation, Estimates, Solution
from orip.report.drawings.svg import ChartFrame, Curve, line_chart
from orip.report.report_input import ReportInput
from orip.report.table import (
    MISSING,
    NO_LINKS,
    PageColumn,
    PageTable,
    counted,
    decimals_of_most,
    deviation,
    fixed,
    probability,
    significant,
)

MOST_POINTS = 2000
_POINTS_ON_PAPER = 40
MOST_PHOTOS = 1000

_STRONG = 0.95
"""Correlation from which an antenna's unknown is marked, as in the listing."""

_CORRELATION = "Largest r: the largest correlation with an unknown of an antenna or camera; marked from 0.95 on."


class Spread(Struct, frozen=True):
    """Median, root mean square and largest standard deviation of one coordinate of many records."""

    name: str
    unit: str
    median: str
    rms: str
    largest: str
    where: str


def spreads(solution: Solution) -> tuple[Spread, ...]:
    """Return the precision of points, projection centres and rotations, one line for each coordinate."""
    unit = solution.ground_unit
    points = [_spread(solution.points, axis, f"Points, {name}", unit) for axis, name in enumerate("XYZ")]
    places = [
        _spread(solution.photos, axis, f"Photos, {name}", unit if axis < 3 else "°")
        for axis, name in enumerate(PHOTO_PARAMETERS)
    ]
    return tuple(spread for spread in (*points, *places) if spread is not None)


def point_table(given: ReportInput) -> PageTable:
    """Return the points by interest: control, check, doubted, then the others, the least precise first.

    If they are very many, the last ones are left out.
    """
    solution = given.solution
    points, unit = solution.points, solution.ground_unit
    rows = _by_interest(solution, given.test_level)[:MOST_POINTS].tolist()
    decimals = decimals_of_most(points.sd)
    names = [points.names[row] for row in rows]
    columns = [
        PageColumn("Point", names, words=True, links={name: given.place(point=name) for name in names}),
        PageColumn("Kind", list(coded(solution.point_kinds)[rows]), key="kind", words=True),
        PageColumn("Rays", [str(solution.point_rays[row]) for row in rows], key="rays"),
    ]
    for axis, name in enumerate("XYZ"):
        columns.append(_values(points, rows, axis, (name, unit), decimals))
    for axis, name in enumerate("XYZ"):
        columns.append(_deviations(points, rows, axis, (name, unit), decimals))
    largest = _largest_standard_residuals(solution, rows)
    columns.append(PageColumn("Largest standard residual", [fixed(size, 1) for size in largest]))
    note = "Control points, check points, those in doubt, then the others: the least precise first."
    left_out = _thinned(len(rows), len(points.names), "point", "points")
    return PageTable("points", "Ground points", columns, f"{note} {left_out}".strip(), on_paper=_POINTS_ON_PAPER)


def _by_interest(solution: Solution, test_level: float | None) -> IntArray:
    """Return the rows of all points: control, check, doubted and rejected ones, others; the least precise first."""
    names, kinds = solution.points.names, coded(solution.point_kinds)
    place = places_of_names(names)
    suspects = suspect_rows(solution, test_level)
    doubted = [place.get(point_of_measurement(name), -1) for name in coded(solution.residuals.point)[suspects]]
    rank = np.full(len(names), 3)
    rank[[row for row in doubted if row >= 0]] = 2
    for number, kind in ((2, "rejected"), (1, "check"), (0, "control")):
        rank[kinds.where(kind.__eq__)] = number
    sd = np.nan_to_num(solution.points.sd, nan=-1.0, posinf=np.inf).max(axis=1, initial=-1.0)
    order = np.where(rank < 2, 0.0, -sd)
    return np.asarray(np.lexsort((order, rank)))  # equal ones stay in their order


def photo_table(solution: Solution, anchors: Mapping[str, str] = NO_LINKS) -> PageTable:
    """Return the photos' exterior orientation with standard deviations."""
    photos, unit = solution.photos, solution.ground_unit
    rows = _least_precise(photos, MOST_PHOTOS)
    place, turn = decimals_of_most(photos.sd[:, :3]), decimals_of_most(photos.sd[:, 3:])
    columns = [PageColumn("Photo", [photos.names[row] for row in rows], words=True, links=anchors)]
    settings = [
        (axis, (name, unit if axis < 3 else "°"), place if axis < 3 else turn)
        for axis, name in enumerate(PHOTO_PARAMETERS)
    ]
    columns += [_values(photos, rows, *setting) for setting in settings]
    columns += [_deviations(photos, rows, *setting) for setting in settings]
    about_axes = any(solution.photo_rotation_sd_about_axes)
    note = _thinned(len(rows), len(photos.names), "photo", "photos")
    if about_axes:
        note += " Where phi is close to ±90°, the sd of the rotations are those about the ground axes X, Y, Z."
    return PageTable("photos", "Photos: exterior orientation", columns, note.strip())


def zero_direction_table(solution: Solution) -> PageTable | None:
    """Return the zero directions of theodolite sets; None where there are none."""
    rows = solution.zero_directions
    if not rows:
        return None
    decimals = decimals_of_most([row.sd for row in rows])
    columns = [
        PageColumn("Set", [row.set for row in rows], words=True),
        PageColumn("R", [fixed(row.value, decimals) for row in rows], "°", "R.value"),
        PageColumn("sd R", [deviation(row.sd, decimals) for row in rows], "°", "R.sd"),
    ]
    return PageTable("theodolites", "Theodolite sets: zero directions", columns)


def figure_table(solution: Solution) -> PageTable | None:
    """Return the figures that points lie on; None where there are none."""
    rows, unit = solution.figures, solution.ground_unit
    if not rows:
        return None
    decimals = decimals_of_most([sd for row in rows for sd in (row.sd_place, row.sd_radius) if not np.isnan(sd)])
    of_angles = decimals_of_most([row.sd_direction for row in rows if not np.isnan(row.sd_direction)] or [1.0])
    columns = [
        PageColumn("Figure", [row.name for row in rows], words=True),
        PageColumn("Kind", [row.kind.lower() for row in rows], words=True),
        PageColumn("Points", [str(row.points) for row in rows]),
        PageColumn("X", [_or_nothing(row.X, decimals) for row in rows], unit, "X"),
        PageColumn("Y", [_or_nothing(row.Y, decimals) for row in rows], unit, "Y"),
        PageColumn("Z", [fixed(row.Z, decimals) for row in rows], unit, "Z"),
        PageColumn("sd", [deviation(row.sd_place, decimals) for row in rows], unit, "sd_place"),
        *(
            PageColumn(f"d{axis}", [_or_nothing(getattr(row, f"d{axis}"), 6) for row in rows], "", f"d{axis}")
            for axis in "XYZ"
        ),
        PageColumn("sd of direction", [_sd_or_nothing(row.sd_direction, of_angles) for row in rows], "°"),
        PageColumn("Radius", [_or_nothing(row.radius, decimals) for row in rows], unit, "radius"),
        PageColumn("sd of radius", [_sd_or_nothing(row.sd_radius, decimals) for row in rows], unit),
        PageColumn("RMS v", [fixed(row.rms, decimals) for row in rows], unit, "rms"),
    ]
    note = "A place on each, its direction (of a plane the normal), and the distances of its points."
    return PageTable("figures", "Lines, planes, cylinders and equal heights", columns, note)


def _or_nothing(value: float, decimals: int) -> str:
    return "" if np.isnan(value) else fixed(value, decimals)


def _sd_or_nothing(value: float, decimals: int) -> str:
    return "" if np.isnan(value) else deviation(value, decimals)


def antenna_table(solution: Solution) -> PageTable | None:
    """Return the parameters of antennas, shifts and drifts; None where there are no antennas."""
    rows = solution.antennas
    if not rows:
        return None
    decimals = [decimals_of_most([row.sd]) for row in rows]
    largest = [_largest_correlation(solution, row) for row in rows]
    columns = [
        PageColumn("Antenna", [row.antenna for row in rows], words=True),
        PageColumn("Strip", [row.strip for row in rows], words=True),
        PageColumn("Parameter", [row.name for row in rows], words=True),
        PageColumn("Value", [fixed(row.value, own) for row, own in zip(rows, decimals, strict=True)], "", "value"),
        PageColumn("sd", [deviation(row.sd, own) for row, own in zip(rows, decimals, strict=True)], "", "sd"),
        PageColumn("Unit", [unit_of_unknown(row.name, solution.ground_unit) for row in rows], words=True),
        PageColumn("Largest r", ["" if pair is None else f"{pair.r:+.3f}" for pair in largest]),
        PageColumn("with", ["" if pair is None else pair.b for pair in largest], words=True),
    ]
    strong = frozenset(row for row, pair in enumerate(largest) if pair is not None and abs(pair.r) >= _STRONG)
    return PageTable("antennas", "Antennas: lever arm, boresight, shifts and drifts", columns, _CORRELATION, strong)


def _largest_correlation(solution: Solution, row: AntennaEstimate) -> Correlation | None:
    """Return the largest correlation of a parameter, `b` being the other unknown; None of a constant."""
    name = f"antenna {f'{row.antenna} strip {row.strip}' if row.strip else row.antenna}.{row.name}"
    own = [pair for pair in solution.correlations if name in (pair.a, pair.b)]
    if not own:
        return None
    largest = max(own, key=lambda pair: abs(pair.r))
    return Correlation(name, largest.b if largest.a == name else largest.a, largest.r)


def _values(estimates: Estimates, rows: list[int], axis: int, label: tuple[str, str], decimals: int) -> PageColumn:
    cells = [fixed(value, decimals) for value in estimates.values[rows, axis].tolist()]
    return PageColumn(label[0], cells, label[1], f"{label[0]}.value")


def _deviations(estimates: Estimates, rows: list[int], axis: int, label: tuple[str, str], decimals: int) -> PageColumn:
    cells = [deviation(value, decimals) for value in estimates.sd[rows, axis].tolist()]
    return PageColumn(f"sd {label[0]}", cells, label[1], f"{label[0]}.sd")


def _least_precise(estimates: Estimates, most: int) -> list[int]:
    """Return all rows in their order if they are few enough, else those with the largest standard deviations."""
    if len(estimates.names) <= most:
        return list(range(len(estimates.names)))
    # np.inf, an unknown that nothing determines, comes first; a constant last
    x, y, z = np.nan_to_num(estimates.sd[:, :3], nan=0.0, posinf=np.inf).T
    largest = np.maximum(np.maximum(x, y), z)
    least = np.partition(largest, -most)[-most]
    larger, equal = np.flatnonzero(largest > least), np.flatnonzero(largest == least)
    rows: list[int] = np.sort(np.concatenate([larger, equal[: most - len(larger)]])).tolist()
    return rows


def _largest_standard_residuals(solution: Solution, rows: list[int]) -> list[float]:
    """Return the largest standard residual of each of these points; NaN for one without residuals."""
    residuals, names = solution.residuals, solution.points.names
    point = coded(residuals.point)
    wanted = np.full(len(names) + 1, -1)  # the last one: of what is no point
    wanted[rows] = np.arange(len(rows))
    row = wanted[places_of_measured(point, names)][point.codes]
    chosen = np.flatnonzero(row >= 0)
    chosen = chosen[~np.isnan(residuals.weight_factor[chosen])]
    largest = np.full(len(rows), -1.0)
    np.maximum.at(largest, row[chosen], np.nan_to_num(residuals.standard_residual[chosen], nan=-1.0))
    return [size if size >= 0.0 else np.nan for size in largest.tolist()]


def _spread(estimates: Estimates, axis: int, name: str, unit: str) -> Spread | None:
    known = np.flatnonzero(np.isfinite(estimates.sd[:, axis]))
    if not known.size:
        return None
    sd = estimates.sd[known, axis]
    worst = int(known[np.argmax(sd)])
    median, rms = float(np.median(sd)), float(np.sqrt(np.mean(sd**2)))
    figures = [significant(value) for value in (median, rms, float(estimates.sd[worst, axis]))]
    return Spread(name, unit, figures[0], figures[1], figures[2], estimates.names[worst])


def _thinned(shown: int, all_of_them: int, noun: str, what: str) -> str:
    if shown == all_of_them:
        return ""
    return (
        f"The {counted(shown, noun)} with the largest standard deviations of {all_of_them} are shown; "
        f"result.json and 'orip results {what}' have all."
    )


_NOTE = (
    "Factor: estimated over given a-priori error (Helmert's variance components, iterated); the adjustment uses the "
    "estimated errors. p: two-sided probability of a factor as far from 1 by chance if the given errors are right. "
    "Groups with a redundancy below 1, or that cannot be told from another one, keep the given errors."
)
_UNLIKELY = 0.001


def variance_component_table(solution: Solution) -> PageTable | None:
    """Return the estimated a-priori errors; None where they were not estimated."""
    rows = solution.variance_components
    if not rows:
        return None
    columns = (
        PageColumn("Group", [row.name for row in rows], words=True),
        PageColumn("Number", [str(row.number) for row in rows], key="number"),
        PageColumn("Redundancy", [significant(row.redundancy) for row in rows], key="redundancy"),
        PageColumn("Factor", [significant(row.factor, 3) for row in rows], key="factor.value"),
        PageColumn("sd", [significant(row.sd, 2) for row in rows], key="factor.sd"),
        PageColumn("p", [MISSING if math.isnan(row.p) else probability(row.p).removeprefix("= ") for row in rows]),
    )
    emphasised = frozenset(place for place, row in enumerate(rows) if row.p < _UNLIKELY)
    return PageTable("variance_components", "Estimated a-priori errors", columns, _NOTE, emphasised)


def convergence_charts(given: ReportInput) -> tuple[Markup, ...]:
    """Return the three curves, each in a chart of its own: they have no common scale."""
    passes = given.solution.iterations
    if not passes:
        return ()
    ends = [(float(passes[0].iteration), given.bundle.enp_stop), (float(passes[-1].iteration), given.bundle.enp_stop)]
    enp = [Curve([(step.iteration, step.enp) for step in passes], "ENP", "first"), Curve(ends, "enp_stop", "limit")]
    sigma0 = [Curve([(step.iteration, step.sigma0) for step in passes], "sigma0", "second")]
    down = [Curve([(step.iteration, float(step.down_weighted)) for step in passes], "down-weighted", "third")]
    wide = max((step.sigma0 for step in passes), default=1.0) > 10.0 * min(step.sigma0 for step in passes)
    return (
        line_chart("ENP over the iterations", _frame("ENP"), enp),
        line_chart("sigma0 over the iterations", _frame("sigma0", logarithmic=wide), sigma0),
        line_chart("Down-weighted components over the iterations", _frame("down-weighted", counts=True), down),
    )


def iteration_table(solution: Solution) -> PageTable:
    """Return the iterations in numbers."""
    passes = solution.iterations
    columns = (
        PageColumn("Iteration", [str(step.iteration) for step in passes], key="iteration"),
        PageColumn("ENP", [fixed(step.enp, 2) for step in passes], key="enp"),
        PageColumn("sigma0", [significant(step.sigma0, 5) for step in passes], key="sigma0"),
        PageColumn("Down-weighted", [str(step.down_weighted) for step in passes], key="down_weighted"),
        PageColumn("Singular", [str(step.singular) for step in passes], key="singular"),
    )
    shortened = [str(step.iteration) for step in passes if step.step_limited]
    note = f"Steps were shortened in iteration {', '.join(shortened)}." if shortened else ""
    return PageTable("iterations", "Iterations", columns, note)


def _frame(up: str, *, logarithmic: bool = False, counts: bool = False) -> ChartFrame:
    return ChartFrame("iteration", up, 340.0, 200.0, True, logarithmic, counts)
