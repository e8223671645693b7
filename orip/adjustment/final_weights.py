"""What is improved once the weights are steady, so that the solution depends less on the starting values.

The weight of an observation falls at once from 1 to 0.37, so that iterations can end with it on either side of the
limit, and points may have followed a wrong observation. First blocks are moved to where more of their observations fit,
three times at most; then full weight is restored to observations that would fit with it, one at a time, each once.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Generic

import numpy as np

from orip.adjustment.equations import Equations, Linearised, Problem, StateT
from orip.adjustment.normals import SolvedNormals
from orip.adjustment.precision import cofactors
from orip.arrays import FloatArray

_MOST_CONSENSUS_MOVES = 3


@dataclass(frozen=True, slots=True)
class Restoration:
    """What has been improved so far.

    Parameters
    ----------
    consensus_moves : int
        Times that a better consensus was looked for.
    restored : set of int
        Observations to which full weight was restored.
    """

    consensus_moves: int = 0
    restored: frozenset[int] = frozenset()


@dataclass(frozen=True, slots=True)
class Improvement(Generic[StateT]):
    """Where the iterations go on, and the observation (or none) that has full weight in the next one."""

    linearised: Linearised[StateT]
    full_weight: int | None = None


def improve(
    problem: Problem[StateT],
    current: Linearised[StateT],
    weights: FloatArray,
    normals: SolvedNormals,
    limit: float,
    done: Restoration,
) -> tuple[Improvement[StateT] | None, Restoration]:
    """Return the next improvement of a solution with steady weights; None if there is none.

    Parameters
    ----------
    problem : Problem
    current : Linearised
    weights : array (n,)
        Weight factors of the next iteration.
    normals : SolvedNormals
        Of the last iteration.
    limit : float
        Standard residual up to which an observation fits.
    done : Restoration
    """
    if done.consensus_moves < _MOST_CONSENSUS_MOVES:
        done = replace(done, consensus_moves=done.consensus_moves + 1)
        state = problem.improve_consensus(current.state, current.equations, limit)
        if state is not None:
            return Improvement(Linearised(state, problem.linearise(state))), done
    row = _fits_with_full_weight(current.equations, weights, normals, limit, done.restored)
    if row is None:
        return None, done
    return Improvement(current, row), replace(done, restored=done.restored | {row})


def _fits_with_full_weight(
    equations: Equations, weights: FloatArray, normals: SolvedNormals, limit: float, restored: frozenset[int]
) -> int | None:
    """Return the down-weighted observation that would fit best with its full weight; None if none would fit.

    With full weight a standard residual u becomes u / (1 + (1 - wf) h), h being its leverage.
    """
    reduced = np.flatnonzero(equations.active & (weights < 1.0))
    reduced = np.array([row for row in reduced if int(row) not in restored], dtype=np.int64)
    if not len(reduced):
        return None
    leverage = cofactors(equations, normals).leverage[reduced]
    with_full_weight = np.abs(equations.residual[reduced]) / (1.0 + (1.0 - weights[reduced]) * leverage)
    best = int(with_full_weight.argmin())
    return int(reduced[best]) if with_full_weight[best] <= limit else None
