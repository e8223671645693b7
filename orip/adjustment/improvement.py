"""Attempts to improve a converged solution, so that it depends less on the starting values.

The weight of an observation falls at once from 1 to 0.37, so that iterations can end with it on either side of the
limit, and points may have followed a wrong observation. First other observations lose their weight in place of those
that have lost it, where the robust cost falls by that; then blocks are moved to where more of their observations fit.
The iterations go on from there. An attempt that does not lower the robust cost is taken back; see docs/decisions/015.
"""

from __future__ import annotations

from dataclasses import replace

from orip.adjustment.acceleration import Acceleration
from orip.adjustment.convergence import TerminationReason
from orip.adjustment.equations import Linearised, Problem, StateT
from orip.adjustment.exchanges import better_exchange
from orip.adjustment.iteration_state import IterationSettings, IterationState, Tried
from orip.adjustment.normals import SolvedNormals

_LONGEST_ATTEMPT = 8
"""Iterations after which an attempt at a better solution is given up."""

_MOST_ATTEMPTS = 6


def next_attempt(
    problem: Problem[StateT], now: IterationState[StateT], normals: SolvedNormals, settings: IterationSettings
) -> IterationState[StateT] | None:
    """Return from where to try for a better solution than a converged one; None if there is nothing to try."""
    # one iteration is left for the way back
    if settings.start_down_weight is None or len(now.records) + 2 > settings.max_iterations:
        return None
    equations, limit = now.current.equations, now.weighing.final_limit
    weights = now.weighing.factors(equations, len(now.records) + 1)
    tried = replace(now.tried, attempts=now.tried.attempts + 1)
    if tried.attempts > _MOST_ATTEMPTS or not (equations.active & (weights < 1.0)).any():
        return None
    # where much is wrong, too much would have to be exchanged
    if not (tried.exchange or now.weighing.of_tracks):
        tried = replace(tried, exchange=True)
        exchange = better_exchange(equations, weights, normals, problem.layout, limit)
        if exchange is not None:
            return _beginning(replace(now, tried=tried, exchange=exchange), now)
    if not tried.consensus:
        tried = replace(tried, consensus=True)
        state = problem.improve_consensus(now.current.state, equations, limit)
        if state is not None:
            moved = Linearised(state, problem.linearise(state))
            return _beginning(replace(now, tried=tried, current=moved), now)
    return None


def _beginning(attempt: IterationState[StateT], before: IterationState[StateT]) -> IterationState[StateT]:
    return replace(attempt, acceleration=Acceleration(), converged=replace(before, tried=attempt.tried), returned=False)


def judged_attempt(
    now: IterationState[StateT],
    before: IterationState[StateT],
    reason: TerminationReason | None,
    settings: IterationSettings,
) -> tuple[IterationState[StateT], TerminationReason | None]:
    """Return where to go on during an attempt, and why the iterations end: a solution that is no better is left."""
    used_up = (
        len(now.records) - len(before.records) >= _LONGEST_ATTEMPT or len(now.records) + 1 >= settings.max_iterations
    )
    if reason is None and not used_up:
        return now, None
    found, known = now.weighing.cost(now.current.equations), before.weighing.cost(before.current.equations)
    if reason is TerminationReason.CONVERGED and found < known:
        return replace(now, converged=None, tried=Tried(now.tried.attempts)), reason
    stopped = TerminationReason.STOPPED if reason is TerminationReason.STOPPED else None
    return replace(before, tried=now.tried, records=now.records, returned=True), stopped
