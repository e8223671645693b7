"""What has to be small, besides ENP, before the iterations end: changes of angles, of coordinates, or of v^T P v.

They are the criteria of OLTRIS (Kersten, Baltsavias, Schwarz and Leiss 1992): averages over the block, in the units of
the project.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from orip.adjustment.equations import Equations, Linearised
from orip.arrays import FloatArray
from orip.bundle.problem import BlockProblem
from orip.bundle.state import BlockState
from orip.bundle.unknowns import CONSTANT
from orip.geometry.rotation import rotation_vectors_with_partials
from orip.units import DEGREES_PER_RADIAN

Criterion = Callable[[Linearised[BlockState], Linearised[BlockState], FloatArray], bool]


def stop_criterion(problem: BlockProblem) -> Criterion | None:
    """Return whether an iteration, from one state to the next, with weight factors (n,), was small enough.

    None: the bundle has no criterion but ENP.
    """
    definition, unknowns = problem.block.definition, problem.unknowns
    angles, coordinates, vtpv = definition.stop_angles, definition.stop_coordinates, definition.stop_vtpv
    if angles is None and coordinates is None and vtpv is None:
        return None
    turns, moves = (unknowns.photos[:, 3:] != CONSTANT).any(axis=1), (unknowns.photos[:, :3] != CONSTANT).any(axis=1)
    moving_points = (unknowns.points != CONSTANT).any(axis=1)

    def is_small(before: Linearised[BlockState], after: Linearised[BlockState], weights: FloatArray) -> bool:
        one, other = before.state, after.state
        turned = rotation_vectors_with_partials(other.rotations[turns] @ np.swapaxes(one.rotations[turns], 1, 2))[0]
        moved = np.concatenate(
            [(other.centres - one.centres)[moves].ravel(), (other.points - one.points)[moving_points].ravel()]
        )
        then, now = _square_sum(before.equations, weights), _square_sum(after.equations, weights)
        return (
            (angles is None or DEGREES_PER_RADIAN * _average(turned) <= angles)
            and (coordinates is None or _average(moved) <= coordinates)
            and (vtpv is None or abs(now - then) <= vtpv * max(now, np.finfo(np.float64).tiny))
        )

    return is_small


def _average(changes: FloatArray) -> float:
    return float(np.mean(np.abs(changes))) if changes.size else 0.0


def _square_sum(equations: Equations, weights: FloatArray) -> float:
    taking_part = equations.active & ~equations.exact
    return float(np.sum(weights[taking_part] * equations.residual[taking_part] ** 2))
