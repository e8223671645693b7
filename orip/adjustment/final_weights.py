"""What is tried once the iterations have converged, so that the solution depends less on the starting values.

The weight of an observation falls at once from 1 to 0.37, so that iterations can end with it on either side of the
limit, and points may have followed a wrong observation. First blocks are moved to where more of their observations fit;
then other observations lose their weight in place of those that have lost it, where the robust cost falls by that. The
iterations go on from there, and the robust cost decides whether the solution they lead to is better; see
docs/decisions/015.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Generic

from orip.adjustment.equations import Linearised, Problem, StateT
from orip.adjustment.exchanges import Exchange, better_exchange
from orip.adjustment.normals import SolvedNormals
from orip.arrays import FloatArray

_MOST_ATTEMPTS = 6


@dataclass(frozen=True, slots=True)
class Tried:
    """What has been tried so far.

    Parameters
    ----------
    attempts : int
    exchange, consensus : bool
        Whether it was looked for at the present solution.
    """

    attempts: int = 0
    exchange: bool = False
    consensus: bool = False

    def at_better_solution(self) -> Tried:
        """Return the same for the solution that the last attempt has led to."""
        return Tried(self.attempts)


@dataclass(frozen=True, slots=True)
class Proposal(Generic[StateT]):
    """From where the iterations may find a better solution: a state, and other weights in the next iteration."""

    linearised: Linearised[StateT]
    exchange: Exchange | None = None


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
    if tried.attempts >= _MOST_ATTEMPTS or not (current.equations.active & (weights < 1.0)).any():
        return None, tried
    if not tried.exchange:
        tried = replace(tried, exchange=True)
        exchange = better_exchange(current.equations, weights, normals, problem.layout, limit)
        if exchange is not None:
            return Proposal(current, exchange), replace(tried, attempts=tried.attempts + 1)
    if not tried.consensus:
        tried = replace(tried, consensus=True)
        state = problem.improve_consensus(current.state, current.equations, limit)
        if state is not None:
            moved = Linearised(state, problem.linearise(state))
            return Proposal(moved), replace(tried, attempts=tried.attempts + 1)
    return None, tried
