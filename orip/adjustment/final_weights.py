"""What is tried once the iterations have converged, so that the solution depends less on the starting values.

The weight of an observation falls at once from 1 to 0.37, so that iterations can end with it on either side of the
limit, and points may have followed a wrong observation. First blocks are moved to where more of their observations fit;
then full weight is restored to the observations that would fit with it, all together and, if that does not help, the
best of them alone. The iterations go on from there, and the robust cost decides whether the solution they lead to is
better; see docs/decisions/015.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Generic

import numpy as np

from orip.adjustment.equations import Equations, Linearised, Problem, StateT
from orip.adjustment.normals import SolvedNormals
from orip.adjustment.precision import cofactors
from orip.arrays import FloatArray, IntArray

_MOST_CONSENSUS_MOVES = 3
_MOST_ALONE = 3


@dataclass(frozen=True, slots=True)
class Tried:
    """What has been tried so far.

    Parameters
    ----------
    consensus_moves : int
        Times that a better consensus was looked for.
    together, alone : sets of int
        Observations to which full weight was restored, with others and by themselves.
    """

    consensus_moves: int = 0
    together: frozenset[int] = frozenset()
    alone: frozenset[int] = frozenset()


@dataclass(frozen=True, slots=True)
class Proposal(Generic[StateT]):
    """From where the iterations may find a better solution: a state, and observations with full weight in the next one.

    Parameters
    ----------
    linearised : Linearised
    full_weight : tuple of int
    """

    linearised: Linearised[StateT]
    full_weight: tuple[int, ...] = ()


def propose(
    problem: Problem[StateT],
    current: Linearised[StateT],
    weights: FloatArray,
    normals: SolvedNormals,
    limit: float,
    tried: Tried,
) -> tuple[Proposal[StateT] | None, Tried]:
    """Return what to try next from a converged solution; None if there is nothing.

    Parameters
    ----------
    problem : Problem
    current : Linearised
    weights : array (n,)
        Weight factors at that state.
    normals : SolvedNormals
        Of the last iteration.
    limit : float
        Standard residual up to which an observation fits.
    tried : Tried
    """
    if not (current.equations.active & (weights < 1.0)).any():
        return None, tried
    if tried.consensus_moves < _MOST_CONSENSUS_MOVES:
        tried = replace(tried, consensus_moves=tried.consensus_moves + 1)
        state = problem.improve_consensus(current.state, current.equations, limit)
        if state is not None:
            return Proposal(Linearised(state, problem.linearise(state))), tried
        tried = replace(tried, consensus_moves=_MOST_CONSENSUS_MOVES)
    fitting = _fitting_with_full_weight(current.equations, weights, normals, limit)
    together = tuple(row for row in fitting.tolist() if row not in tried.together)
    if together:
        alone = tried.alone | {*together} if len(together) == 1 else tried.alone
        return Proposal(current, together), replace(tried, together=tried.together | {*together}, alone=alone)
    best = next((row for row in fitting.tolist() if row not in tried.alone), None)
    if best is None or len(tried.alone) >= _MOST_ALONE:
        return None, tried
    return Proposal(current, (best,)), replace(tried, alone=tried.alone | {best})


def _fitting_with_full_weight(
    equations: Equations, weights: FloatArray, normals: SolvedNormals, limit: float
) -> IntArray:
    """Return the down-weighted observations that would fit with full weight, each by itself, the best first.

    With full weight a standard residual u becomes u / (1 + (1 - wf) h), h being its leverage.
    """
    reduced = np.flatnonzero(equations.active & (weights < 1.0))
    leverage = cofactors(equations, normals).leverage[reduced]
    with_full_weight = np.abs(equations.residual[reduced]) / (1.0 + (1.0 - weights[reduced]) * leverage)
    if equations.groups is not None:
        fitted = np.zeros(len(weights))
        fitted[reduced] = with_full_weight
        among = np.zeros(len(weights), dtype=bool)
        among[reduced] = True
        with_full_weight = equations.sizes(fitted, among)[reduced]
    order = np.argsort(with_full_weight, kind="stable")
    return np.asarray(reduced[order[: np.count_nonzero(with_full_weight <= limit)]])
