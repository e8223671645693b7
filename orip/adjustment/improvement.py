"""Attempts to improve a converged solution: where one begins, how long it may take, and whether its end is better.

What is tried is in `orip.adjustment.final_weights`; the robust cost judges. An attempt that does not lower it is taken
back.
"""

from __future__ import annotations

from dataclasses import replace

from orip.adjustment.acceleration import Acceleration
from orip.adjustment.convergence import TerminationReason
from orip.adjustment.equations import Problem, StateT
from orip.adjustment.final_weights import propose
from orip.adjustment.iteration_state import IterationSettings, IterationState
from orip.adjustment.normals import SolvedNormals

_LONGEST_ATTEMPT = 8
"""Iterations after which an attempt at a better solution is given up."""


def next_attempt(
    problem: Problem[StateT], now: IterationState[StateT], normals: SolvedNormals, settings: IterationSettings
) -> IterationState[StateT] | None:
    """Return from where to try for a better solution than a converged one; None if there is nothing to try."""
    # one iteration is left for the way back
    if settings.start_down_weight is None or len(now.records) + 2 > settings.max_iterations:
        return None
    weights = now.weighing.factors(now.current.equations, len(now.records) + 1)
    proposal, tried = propose(problem, now.current, weights, normals, now.weighing.final_limit, now.tried)
    now = replace(now, tried=tried)
    if proposal is None:
        return None
    return replace(
        now,
        current=proposal.linearised,
        full_weight=proposal.full_weight,
        acceleration=Acceleration(),
        converged=now,
        returned=False,
    )


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
        return replace(now, converged=None), reason
    stopped = TerminationReason.STOPPED if reason is TerminationReason.STOPPED else None
    return replace(before, tried=now.tried, records=now.records, returned=True), stopped
