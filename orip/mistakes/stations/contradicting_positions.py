"""Single positions of photos, in .STA or .ELE, that the block contradicts: slips, wrong fixes, names exchanged."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import combinations

import numpy as np
from msgspec import Struct

from orip.adjustment.weights import MEDIAN_OF_NORMAL
from orip.arrays import FloatArray
from orip.errors import ProjectWarning
from orip.mistakes.control.slips_of_pen import slip_of_pen
from orip.mistakes.mistake import GIVEN_ORIENTATION, POSITIONS_OFF, REPLACED, Consequence, declare
from orip.mistakes.stations.given_positions import PLACES, GivenPositions, given_positions
from orip.records.block import Block
from orip.records.coded_names import coded
from orip.records.photo import PHOTO_PARAMETERS
from orip.records.results.solution import Solution
from orip.structs import replace
from orip.wording import MOST_TO_CHANGE, counted_names

_DOUBTED, _ERRORS = 0.5, 5.0
"""Weight factor below which a position hardly influenced the result, and standard residual from which it is wrong."""

_SINGLE = 0.4
"""Largest part of the positions of a file that are wrong one by one."""

_BESIDE = 0.1
"""Part of the largest difference below which that of another component is not named."""

CODE = declare(
    "contradicting-position", "",
    Consequence(warnings=(REPLACED,)), Consequence(warnings=(GIVEN_ORIENTATION,), of_same_photo=True),
)  # fmt: skip
OFF_ALIKE = declare("positions-off-alike", "positions of a part of the photos are off alike", POSITIONS_OFF)
ALL_ALIKE = declare("all-positions-off-alike", "the positions of the photos are all off alike", POSITIONS_OFF)
SCATTERED = declare(
    "scattered-positions", "the positions of the photos are worse than their a-priori errors, or those of others",
    POSITIONS_OFF,
)  # fmt: skip

_FEWEST_ALIKE = 3
"""Least number of wrong positions of which it is no chance that they are off alike."""

_FEWEST_TOGETHER = 4
"""Wrong positions that no slip explains, of which one warning is given."""

_TOLERANCE = 4.0
"""Standard errors within which a coordinate is the one that was meant."""

_LIKE_STRIP = 0.5
"""Part of the shift of a strip that a station's own difference may differ from it: stations that have lost their weight
one by one have bent the block a little."""

_EXCHANGED = 0.05
"""Part of the distance of two positions that each may be from where the other photo is, if they are exchanged."""


class _Position(Struct, frozen=True):
    """The observed coordinates (k,) of a photo's position, k to 3, and as the block has them.

    `error` is that of their difference, and `doubted` whether the adjustment gave them no weight.
    """

    photo: str
    file: str
    components: tuple[str, ...]
    given: FloatArray
    found: FloatArray
    error: FloatArray
    a_priori: FloatArray
    doubted: bool

    @property
    def off(self) -> FloatArray:
        """Return by what they are off: given minus found."""
        return self.given - self.found

    @property
    def wrong(self) -> list[int]:
        """Return the places of the components that are off, and not hardly beside another one; at least one."""
        off = np.abs(self.off)
        certain = np.flatnonzero((off > _TOLERANCE * self.error) & (off > _BESIDE * off.max())).tolist()
        return certain or [int(np.argmax(off / self.error))]


def contradicting_positions(solution: Solution) -> list[ProjectWarning]:
    """Return warnings for positions of photos that the block contradicts, if most fit: one for each cause.

    Parameters
    ----------
    solution : Solution
        With down-weighting.
    """
    positions = list(_positions(solution))
    wrong = [position for position in positions if position.doubted]
    if len(wrong) > max(2.0, _SINGLE * len(positions)):
        return []
    if alike := _off_alike(wrong, solution.ground_unit):
        return [alike]
    shifts = _shifts_of_strips(solution)
    wrong = [position for position in wrong if not any(_follows(position, shift) for shift in shifts)]
    pairs = [pair for pair in combinations(wrong, 2) if _are_exchanged(*pair)]
    exchanged = [position.photo for pair in pairs for position in pair]
    single = [position for position in wrong if position.photo not in exchanged]
    said = [(position, *_contradiction(position, solution.ground_unit)) for position in single]
    unexplained = [position for position, _, is_explained in said if not is_explained]
    together = len(unexplained) >= _FEWEST_TOGETHER
    return [
        *(_exchange(*pair) for pair in pairs),
        *(warning for _, warning, is_explained in said if is_explained or not together),
        *([_without_fix(unexplained, solution.ground_unit)] if together else []),
    ]


_FEWEST_SCATTERED = 6
"""Positions whose scatter is told."""

_SCATTER, _OF_NEIGHBOURS = 5.0, 0.3
"""Errors from which positions scatter, and part of the distance of neighbours from which they are of other photos."""

_OF_CODE = 30.0
"""Ground units that positions of GNSS without a fix scatter by at most."""

_DIGITS = 2

_ALIKE = ("lever arm", "along the axes", "of strip")
"""Words of contradictions that positions of a flight to and fro have in common."""


_STRAIGHT = 0.8
"""Cosine of the angle between successive bases of one strip, at least."""


def scattered_positions(solution: Solution) -> list[ProjectWarning]:
    """Return why most positions of a file are off, each otherwise, or those of a part of the flight alike.

    Parameters
    ----------
    solution : Solution
        In which photos and control fit.
    """
    positions = list(_positions(solution))
    wrong = [position for position in positions if position.doubted]
    if len(positions) < _FEWEST_SCATTERED or len(wrong) <= max(2.0, _SINGLE * len(positions)):
        return []
    if len({(position.file, position.components) for position in positions}) > 1:
        return []
    off = np.array([position.off for position in positions])
    error = np.median([position.error for position in positions], axis=0)
    is_alike = any(words in found.text for found in solution.diagnosis for words in _ALIKE)
    if is_alike and not _begins_within_a_strip(positions, _beginning_of_part(off, error)):
        return []
    if part := _part_of_flight(positions, off, error, solution.ground_unit):
        return [part]
    if is_alike:
        return []
    scatter = np.median(np.abs(off - np.median(off, axis=0)), axis=0) / MEDIAN_OF_NORMAL
    given = np.median([position.a_priori for position in positions], axis=0)
    if ((scatter < _SCATTER * given) | (scatter < error)).all():
        return []
    where = "exposure stations"
    apart = float(np.median(np.linalg.norm(np.diff([position.found for position in positions], axis=0), axis=1)))
    text = (
        f"their positions scatter by {scatter.max():.{_DIGITS}g} {solution.ground_unit} about those of the photos, "
        f"{(scatter / given).max():.3g} times their a-priori errors: "
    )
    size = float(np.linalg.norm(scatter))
    if size > _OF_NEIGHBOURS * apart:
        text += f"they seem to be those of other photos; match positions and names again in the {wrong[0].file} file"
    elif size > _OF_CODE:
        text += f"they seem to be in another system, or those of other photos; correct them in the {wrong[0].file} file"
    else:
        text += (
            "as those of GNSS without a fix (RTK, PPK) do, or the errors are in another unit; write errors of about "
            f"{scatter.max():.{_DIGITS}g} {solution.ground_unit} in the {wrong[0].file} file"
        )
    return [ProjectWarning(SCATTERED, where, text)]


def part_of_flight_elsewhere(elsewhere: Solution, block: Block) -> list[ProjectWarning]:
    """Return that the positions of a part of the flight are off alike, from an adjustment without those of .ELE."""
    place = {name: row for row, name in enumerate(elsewhere.photos.names)}
    given = given_positions(block)
    observed = [row for row, name in enumerate(given.photos) if name in place and given.errors[row].min() > 0.0]
    if len(observed) < _FEWEST_SCATTERED or given.file != ".ELE":
        return []
    positions = [_elsewhere(elsewhere, place[given.photos[row]], given, row) for row in observed]
    off = np.array([position.off for position in positions])
    error = np.median([position.error for position in positions], axis=0)
    part = _part_of_flight(positions, off, error, elsewhere.ground_unit)
    return [] if part is None else [part]


def alike_elsewhere(elsewhere: Solution, block: Block, photos: Iterable[str]) -> list[ProjectWarning]:
    """Return that the positions of some photos are all off alike, from an adjustment without them."""
    place = {name: row for row, name in enumerate(elsewhere.photos.names)}
    given, chosen = given_positions(block), set(photos)
    every = [row for row, name in enumerate(given.photos) if name in place]
    rows = [row for row in every if given.photos[row] in chosen]
    positions = [_elsewhere(elsewhere, place[given.photos[row]], given, row) for row in rows]
    if len(rows) < len(every):
        alike = _off_alike(positions, block.ground_unit, _SHIFT_OF_STRIP)
        return [] if alike is None else [alike]
    alike = _off_alike(positions, block.ground_unit, _SHIFT_OF_ALL)
    return [] if alike is None else [replace(alike, code=ALL_ALIKE, where="exposure stations")]


def _elsewhere(elsewhere: Solution, photo: int, given: GivenPositions, row: int) -> _Position:
    found, sd = elsewhere.photos.values[photo, :3], np.nan_to_num(elsewhere.photos.sd[photo, :3])
    errors, components = given.errors[row], PLACES if given.file == ".ELE" else tuple("XYZ")
    error = np.hypot(errors, sd)
    return _Position(given.photos[row], given.file, components, given.given[row], found, error, errors, True)


def _beginning_of_part(off: FloatArray, error: FloatArray) -> int:
    """Return from which position on all are off most nearly by the same, and all before it."""

    def spread(row: int) -> float:
        parts = off[:row], off[row:]
        return sum(float(np.sum(np.abs(part - np.median(part, axis=0)) / error)) for part in parts)

    return min(range(_FEWEST_ALIKE, len(off) - _FEWEST_ALIKE + 1), key=spread)


def _begins_within_a_strip(positions: Sequence[_Position], place: int) -> bool:
    """Return whether the flight went straight on where a part begins: a lever arm changes its sign at a turn only."""
    before, there, after = np.diff([position.found for position in positions[place - 2 : place + 2]], axis=0)
    lengths = np.linalg.norm([before, after], axis=1) * np.linalg.norm(there)
    return bool(((before @ there, after @ there) > _STRAIGHT * lengths).any())


def _part_of_flight(
    positions: Sequence[_Position], off: FloatArray, error: FloatArray, ground_unit: str
) -> ProjectWarning | None:
    """Return that the positions from one photo on are off by the same, compared with those before."""
    place = _beginning_of_part(off, error)
    parts = off[:place], off[place:]
    middles = [np.median(part, axis=0) for part in parts]
    spreads = [
        np.median(np.abs(part - middle), axis=0) / MEDIAN_OF_NORMAL for part, middle in zip(parts, middles, strict=True)
    ]
    by = middles[1] - middles[0]
    # a part that keeps its weight holds the block there, and the other part is off alike
    if any((spread > _SCATTER * error).any() for spread in spreads) or not (np.abs(by) > 2.0 * _SCATTER * error).any():
        return None
    first = positions[0]
    listed = ", ".join(f"{name} {value:+.3f}" for name, value in zip(first.components, by.tolist(), strict=True))
    text = (
        f"those from {positions[place].photo} to {positions[-1].photo} are off by {listed} {ground_unit}, compared "
        f"with those before, as where the base station or the reference system changed: correct them in the "
        f"{first.file} file"
    )
    if first.file == ".STA":
        text += (
            '; or give both parts a strip of their own (the last field of their lines) and set shift = "strip" in '
            "[[antenna]] of orip.toml"
        )
    return ProjectWarning(OFF_ALIKE, "exposure stations", text)


def _positions(solution: Solution) -> Iterator[_Position]:
    rows = solution.residuals
    is_position = coded(rows.kind).where(lambda kind: kind in ("station", "element"))
    is_position &= coded(rows.component).where(lambda component: component in {*"XYZ", *PHOTO_PARAMETERS[:3]})
    of_photos: dict[tuple[str, str], list[int]] = {}
    for row in np.flatnonzero(is_position & np.isfinite(rows.weight_factor)).tolist():
        if rows.photo[row]:
            of_photos.setdefault((rows.kind[row], rows.photo[row]), []).append(row)
    place = {name: row for row, name in enumerate(solution.photos.names)}
    for (kind, photo), mine in of_photos.items():
        components = tuple(rows.component[row] for row in mine)
        axes = ["XYZ".index(component[0]) for component in components]
        of_photo = np.nan_to_num(solution.photos.sd[place[photo], axes])
        doubted = (rows.weight_factor[mine] < _DOUBTED) & (rows.standard_residual[mine] > _ERRORS)
        yield _Position(
            photo,
            ".STA" if kind == "station" else ".ELE",
            components,
            rows.observed[mine],
            rows.observed[mine] + rows.residual[mine],
            np.hypot(rows.a_priori[mine] * max(1.0, solution.sigma0), of_photo),
            rows.a_priori[mine],
            bool(doubted.any()),
        )


_SHIFT_OF_STRIP = (
    '; or give them a strip of their own there (the last field of their lines) and set shift = "strip" and strips = '
    "its name in [[antenna]] of orip.toml"
)
_SHIFT_OF_ALL = '; or set shift = "session" in [[antenna]] of orip.toml'


def _off_alike(wrong: Sequence[_Position], ground_unit: str, shift: str = _SHIFT_OF_STRIP) -> ProjectWarning | None:
    """Return one warning for positions that are all off by the same, as those of a strip without a fix are."""
    if len(wrong) < _FEWEST_ALIKE or len({(position.file, position.components) for position in wrong}) > 1:
        return None
    off = np.array([position.off for position in wrong])
    error = np.median([position.error for position in wrong], axis=0)
    middle = np.median(off, axis=0)
    if (np.abs(off - middle).max(axis=0) > _ERRORS * error).any():
        return None
    first = wrong[0]
    differ = (np.abs(middle) > _TOLERANCE * error / np.sqrt(len(wrong))) & (
        np.abs(middle) > _BESIDE * np.abs(middle).max()
    )
    listed = ", ".join(f"{first.components[place]} {middle[place]:+.3f}" for place in np.flatnonzero(differ).tolist())
    text = (
        f"their positions contradict the block, and are all off by {listed} {ground_unit}: correct them in the "
        f"{first.file} file, or make their errors negative (then they are only compared)"
    )
    if first.file == ".STA":
        text += shift
    return ProjectWarning(OFF_ALIKE, _named(wrong), text)


def _named(wrong: Sequence[_Position]) -> str:
    return counted_names("exposure station", [position.photo for position in wrong], MOST_TO_CHANGE)


def _shifts_of_strips(solution: Solution) -> list[dict[str, float]]:
    """Return by what strips whose stations are doubted as a group are off, by axis."""
    of_strips: dict[str, dict[str, float]] = {}
    doubted = {group.of for group in solution.groups if group.kind == "station" and group.doubted}
    for group in solution.groups:
        if group.kind == "station" and group.of in doubted and np.isfinite(group.shift):
            of_strips.setdefault(group.of, {})[group.component] = group.shift
    return list(of_strips.values())


def _follows(position: _Position, shift: Mapping[str, float]) -> bool:
    """Tell whether a position is off as its strip is, of which that is said: not by a slip of its own."""
    of_strip = np.array([shift.get(component[0], 0.0) for component in position.components])
    return bool(np.linalg.norm(position.off - of_strip) <= _LIKE_STRIP * np.linalg.norm(of_strip))


def _are_exchanged(one: _Position, other: _Position) -> bool:
    """Tell whether each position is where the other photo is."""
    if one.components != other.components or len(one.components) < len("XYZ"):
        return False
    apart = float(np.linalg.norm(one.given - other.given))
    there = (float(np.linalg.norm(a.given - b.found)) for a, b in ((one, other), (other, one)))
    return max(there) < _EXCHANGED * apart


def _exchange(one: _Position, other: _Position) -> ProjectWarning:
    text = (
        f"exposure stations {one.photo} and {other.photo} fit when they are exchanged; exchange their names in the "
        f"{one.file} file; or in the POINTS lines, if what was measured stands under the other name"
    )
    return ProjectWarning(CODE, "", text)


def _without_fix(wrong: Sequence[_Position], ground_unit: str) -> ProjectWarning:
    """Return one warning for positions that are off one by one, as where GNSS has lost its fix."""
    sizes = sorted(float(np.linalg.norm(position.off)) for position in wrong)
    text = (
        f"their positions contradict the block, by {sizes[0]:.2g} to {sizes[-1]:.2g} {ground_unit}: check whether GNSS "
        f"had a fix there: correct them in the {wrong[0].file} file, or make their errors negative (then they are only "
        "compared)"
    )
    return ProjectWarning(CODE, _named(wrong), text)


def _contradiction(position: _Position, ground_unit: str) -> tuple[ProjectWarning, bool]:
    """Return a warning for a position, and whether it has the slip in writing that explains it."""
    components, file = position.components, position.file
    off = ", ".join(f"{components[place]} {position.off[place]:+.3f}" for place in position.wrong)
    text = f"its position contradicts the block: it is off by {off} {ground_unit}"
    slips = [
        (place, slip_of_pen(float(given), float(found), _TOLERANCE * float(error)))
        for place, (given, found, error) in enumerate(zip(position.given, position.found, position.error, strict=True))
        if place in position.wrong
    ]
    is_explained = True
    if len(components) == len("XYZ") and _axes_are_exchanged(position):
        text += f": its {components[0]} and {components[1]} are exchanged; exchange them in the {file} file"
    elif slips and all(slip for _, slip in slips):
        listed = "; ".join(f"{components[place]} = {position.given[place]:.10g} {slip}" for place, slip in slips)
        text += f": {listed}; correct it in the {file} file"
    else:
        is_explained = False
        text += (
            f"; check it, and whether GNSS had a fix there: correct it in the {file} file, or make its errors negative "
            "(then it is only compared)"
        )
    return ProjectWarning(CODE, f"exposure station {position.photo}", text), is_explained


def _axes_are_exchanged(position: _Position) -> bool:
    off = np.abs(position.given[[1, 0, 2]] - position.found)
    return bool((off <= _ERRORS * position.error).all())
