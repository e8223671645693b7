"""Distances that contradict each other or the block: in another unit, with a slip in writing, or between other points.

Which of them is wrong shows in what would make all of them fit. Where distances alone give the scale it lies anywhere
between them, and none need fit. What the block has for one divided by what it has for another does not depend on its
scale.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import chain, combinations

import numpy as np
from msgspec import Struct

from orip.arrays import BoolArray, FloatArray, IntArray
from orip.errors import ProjectWarning
from orip.mistakes.control.slips_of_pen import slip_of_pen
from orip.mistakes.mistake import Consequence, declare
from orip.mistakes.other_units import LENGTH_UNITS
from orip.records.block import Block
from orip.records.coded_names import coded
from orip.records.control import ControlDistance
from orip.records.names import places_of_names
from orip.records.results.solution import Solution
from orip.structs import replace
from orip.wording import joined

CODE = declare("contradicting-distance", "", Consequence(groups=("distance",)))

TOLERANCE = 4.0
"""Standard errors within which a distance is the one that was meant, or the one to another point."""

_BY_CHANCE = 0.2
"""Largest expected number of points that match by chance; with more of them a match proves nothing."""

_SHOWN = 3
"""Most pairs of ends that are named."""

_FEWEST = 3
"""Distances of which those that agree tell that the other one is wrong, whatever the reason."""


_THE_OTHERS = "the other distances, which agree: with their"


class _Distances(Struct, frozen=True):
    """Distances as given (n,), as the block has them in its own scale, and the standard errors of their differences."""

    names: list[str]
    given: FloatArray
    in_block: FloatArray
    error: FloatArray

    def scale_without(self, left_out: int) -> float | None:
        """Return the scale of all but one distance, None where they contradict each other."""
        others = np.arange(len(self.names)) != left_out
        scale = float(np.median((self.given / self.in_block)[others]))
        return scale if self._fits(scale)[others].all() else None

    def is_in_agreement(self) -> bool:
        """Tell whether all distances have one scale."""
        return bool(self._fits(float(np.median(self.given / self.in_block))).all())

    def _fits(self, scale: float) -> BoolArray:
        return np.abs(self.given - scale * self.in_block) <= TOLERANCE * self.error


def distances_against_each_other(block: Block, solution: Solution) -> list[ProjectWarning]:
    """Return which distances are wrong, where most contradict the block, and one mistake explains that.

    Parameters
    ----------
    block : Block
        As gathered.
    solution : Solution
        With down-weighting.
    """
    known = {distance.name: distance for distance in block.distances}
    distances = _distances(solution, known)
    if len(distances.names) <= 1 or distances.is_in_agreement():
        return []
    pairs = [
        pair for pair in combinations(range(len(distances.names)), 2) if _exchanged(distances, *pair).is_in_agreement()
    ]
    if len(pairs) == 1:
        one, other = (distances.names[row] for row in pairs[0])
        text = f"distances {one} and {other} fit when they are exchanged; exchange their lengths in the .LEN file"
        return [ProjectWarning(CODE, "", text)]
    explained: list[ProjectWarning] = []
    contradicted: list[ProjectWarning] = []
    for row, name in enumerate(distances.names):
        scale = distances.scale_without(row)
        if scale is None:
            continue
        tolerance = TOLERANCE * float(distances.error[row])
        others = "the other distance: with its" if len(distances.names) < _FEWEST else _THE_OTHERS
        seen = scale * float(distances.in_block[row])
        text = f"{distances.given[row]:.10g} contradicts {others} scale it is {seen:.6g} "
        text += solution.ground_unit
        meant = _meant(solution, known[name], seen, scale, tolerance)
        found = ProjectWarning(CODE, f"distance {name}", f"{text}{meant}; check the distance and its ends")
        (explained if meant else contradicted).append(found)
    if len(explained) > 1:
        return [_either(explained)]
    if explained or len(distances.names) >= _FEWEST:
        return explained or (contradicted if len(contradicted) == 1 else [])
    return [_contradiction(distances)] if give_the_scale_alone(solution) else []


def give_the_scale_alone(solution: Solution) -> bool:
    """Tell whether no coordinates of points or photos are observed, so that no distance is wrong by itself."""
    rows = solution.residuals
    others = coded(rows.kind).where(lambda kind: kind in ("control", "station", "element"))
    return not (others & (rows.weight_factor > 0.0)).any()


def _either(explained: Sequence[ProjectWarning]) -> ProjectWarning:
    """Return one warning of several distances each of which alone may be wrong."""
    names = [found.where.removeprefix("distance ") for found in explained]
    text = "; or ".join(f"{name}: {found.text}" for name, found in zip(names, explained, strict=True))
    return ProjectWarning(CODE, f"distances {joined(names, 'or')}", f"one of them is wrong: {text}")


def _contradiction(distances: _Distances) -> ProjectWarning:
    """Return that two distances contradict each other, of which it cannot be told which is wrong."""
    one, other = distances.names
    ratio = distances.given / distances.in_block
    text = (
        f"they contradict each other by {100.0 * abs(ratio[0] / ratio[1] - 1.0):.2g} %, and nothing tells which is "
        "wrong: check their lengths, unit and ends, and measure a third one"
    )
    return ProjectWarning(CODE, f"distances {one} and {other}", text)


def _distances(solution: Solution, known: Mapping[str, ControlDistance]) -> _Distances:
    rows, points = solution.residuals, solution.points
    used = coded(rows.kind).where("distance".__eq__) & coded(rows.component).where("XYZ".__eq__) & (rows.a_priori > 0.0)
    mine = np.flatnonzero(used & np.isfinite(rows.residual))
    if not len(mine):
        return _Distances([], *np.zeros((3, 0)))
    names = [rows.point[row] for row in mine.tolist()]
    place = places_of_names(points.names)
    ends = [[place[known[name].start], place[known[name].end]] for name in names]
    # an end may lose its height together with its distance: it is known as well as the other points nevertheless
    sd = np.where(np.isfinite(points.sd), points.sd, np.nanmedian(points.sd, axis=0))
    of_ends = np.linalg.norm(sd[ends].reshape(len(ends), -1), axis=1)
    given, error = rows.observed[mine], rows.a_priori[mine] * max(1.0, solution.sigma0)
    return _Distances(names, given, given + rows.residual[mine], np.hypot(error, of_ends))


def _exchanged(distances: _Distances, one: int, other: int) -> _Distances:
    given = distances.given.copy()
    given[[one, other]] = given[[other, one]]
    return replace(distances, given=given)


def _meant(solution: Solution, distance: ControlDistance, seen: float, scale: float, tolerance: float) -> str:
    """Return the slip, or the other ends, that explain a distance; "" where none does."""
    slip = slip_of_pen(distance.distance, seen, tolerance)
    if slip is not None and "one digit" not in slip:
        return f": it {slip}"
    others = other_ends(solution, distance, distance.distance / scale, tolerance / scale)
    fitting = " or ".join(f"from {start} to {end}" for start, end in others[:_SHOWN])
    return f": it fits {fitting}; correct the names of its ends" if others else ""


def other_ends(solution: Solution, distance: ControlDistance, length: float, tolerance: float) -> list[tuple[str, str]]:
    """Return the pairs of points, one of them an end of a distance, that are as far apart as a length in the block.

    Empty where chance would find some, and for components of a distance, which many points share.
    """
    if distance.code != "XYZ":
        return []
    points = solution.points
    place = places_of_names(points.names)
    pairs, chances = [], 0.0
    for end in (distance.start, distance.end):
        lengths = np.linalg.norm(points.values - points.values[place[end]], axis=1)
        chances += len(lengths) * 2.0 * tolerance / max(float(np.nanmax(lengths)), tolerance)
        near = np.flatnonzero(np.abs(lengths - length) <= tolerance)
        pairs.append([(end, points.names[row]) for row in near])
    return list(chain(*pairs)) if chances <= _BY_CHANCE else []


DISTANCE_UNIT = declare(
    "distance-unit", "distances are in another unit than the other distances or the control",
    Consequence(groups=("distance", "exposure station", "control point")),
)  # fmt: skip
"""Code of the warning, and what the status says."""

_LENGTH_ALIKE = 0.01
"""Relative difference within which a factor is recognised: wrong distances may have changed the scale of the block."""

_DOUBTED = 5.0
"""Standard residual from which an observation does not fit."""


def contradicting_distances(block: Block, solution: Solution) -> list[ProjectWarning]:
    """Return a warning if distances are in another unit, all or some; else one for each that the block contradicts.

    Parameters
    ----------
    block : Block
        As gathered.
    solution : Solution
        With down-weighting.
    """
    rows = solution.residuals
    is_distance = coded(rows.kind).where(lambda kind: kind.endswith("distance"))
    wrong = is_distance & (rows.standard_residual > _DOUBTED)
    if not wrong.any():
        return []
    if found := list(_in_two_units(solution, np.flatnonzero(is_distance))):
        return found
    if found := list(_in_another_unit(solution, np.flatnonzero(wrong))):
        return found
    if solution.status == "not_converged":
        return []
    are_most = np.count_nonzero(wrong) > 0.5 * np.count_nonzero(is_distance)
    if are_most or give_the_scale_alone(solution):
        found = distances_against_each_other(block, solution)
        if found or are_most:
            return found
    return [_contradiction_of_block(block, solution, int(row)) for row in np.flatnonzero(wrong)]


def _in_another_unit(solution: Solution, wrong: IntArray) -> Iterator[ProjectWarning]:
    rows = solution.residuals
    observed = rows.observed[wrong]
    ratios = (observed + rows.residual[wrong]) / observed
    factor = min(LENGTH_UNITS, key=lambda unit: float(np.median(np.abs(np.log(np.abs(ratios) / unit)))))
    if not (np.abs(ratios / factor - 1.0) < _LENGTH_ALIKE).all():
        return
    unit, other = LENGTH_UNITS[factor]
    names = ", ".join(rows.point[row] for row in wrong)
    text = (
        f"the distances fit when they are multiplied by {factor:.5g} ({names}): they seem to be in {unit}, and the "
        f"control in {other}; write both in one unit, and correct the one that is wrong"
    )
    yield ProjectWarning(DISTANCE_UNIT, "control files", text)


def _in_two_units(solution: Solution, all_distances: IntArray) -> Iterator[ProjectWarning]:
    """Yield a warning where some distances fit the others once they are multiplied by the factor of a unit.

    Where distances alone give the scale it lies anywhere between the two, so that none of them need fit; what the
    block has for one divided by what it has for another does not depend on its scale.
    """
    rows = solution.residuals
    observed = rows.observed[all_distances]
    ratios = np.abs((observed + rows.residual[all_distances]) / observed)
    smallest = ratios < np.sqrt(ratios.min() * ratios.max())
    if not smallest.any() or smallest.all():
        return
    common, other_common = float(np.median(ratios[smallest])), float(np.median(ratios[~smallest]))
    fitted = np.where(smallest, ratios / common, ratios / other_common)
    factor = min(
        (unit for unit in LENGTH_UNITS if unit < 1.0), key=lambda unit: abs(common / other_common / unit - 1.0)
    )
    if (np.abs(fitted - 1.0) > _LENGTH_ALIKE).any() or abs(common / other_common / factor - 1.0) > _LENGTH_ALIKE:
        return
    unit, other = LENGTH_UNITS[factor]
    names, other_names = (
        ", ".join(rows.point[row] for row in all_distances[chosen]) for chosen in (smallest, ~smallest)
    )
    text = (
        f"the distances fit each other with the factor {factor:.5g} for {names}: written in {unit}, as it seems, and "
        f"{other_names} in {other}; write all distances and their errors in the ground unit, {solution.ground_unit}"
    )
    yield ProjectWarning(DISTANCE_UNIT, "control files", text)


def _contradiction_of_block(block: Block, solution: Solution, row: int) -> ProjectWarning:
    rows = solution.residuals
    name, given = rows.point[row], float(rows.observed[row])
    seen, error = given + float(rows.residual[row]), float(rows.a_priori[row])
    tolerance = TOLERANCE * error * max(1.0, solution.sigma0)
    distance = next(known for known in block.distances if known.name == name)
    text = f"{given:.10g} contradicts the block, which has {seen:.6g} {solution.ground_unit}"
    slip = slip_of_pen(given, seen, tolerance)
    others = other_ends(solution, distance, distance.distance, tolerance)
    if slip is not None and "one digit" not in slip:
        text += f": it {slip}"
    elif others:
        text += f": it fits from {others[0][0]} to {others[0][1]}; correct the names of its ends"
    elif slip is not None:
        text += f": it {slip}"
    text += f"; check the distance, and that its ends are {distance.start} and {distance.end}"
    return ProjectWarning(CODE, f"distance {name}", text)
