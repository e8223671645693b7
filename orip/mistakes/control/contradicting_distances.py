"""Distances that contradict the block: in another unit, with a slip in writing, or between other points."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from orip.arrays import IntArray
from orip.errors import ProjectWarning
from orip.mistakes.control.distances_alone import (
    CODE,
    TOLERANCE,
    distances_against_each_other,
    give_the_scale_alone,
    other_ends,
)
from orip.mistakes.control.slips_of_pen import slip_of_pen
from orip.mistakes.mistake import Consequence, declare
from orip.mistakes.other_units import LENGTH_UNITS
from orip.records.block import Block
from orip.records.coded_names import coded
from orip.records.results.solution import Solution

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
    return [_contradiction(block, solution, int(row)) for row in np.flatnonzero(wrong)]


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


def _contradiction(block: Block, solution: Solution, row: int) -> ProjectWarning:
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
