"""Attempts to improve a converged solution, so that it depends less on the starting values.

The weight of an observation falls at once from 1 to 0.37, so that iterations can end with it on either side of the
limit, and points may have followed a wrong observation. First other observations lose their weight in place of those
that have lost it, where the robust cost falls by that; then blocks are moved to where more of their observations fit.
The iterations go on from there. An attempt that does not lower the robust cost is taken back; see docs/decisions/015.
"""

from __future__ import annotations

from collections.abc import Sequence
from operator import itemgetter

import numpy as np

from orip.adjustment.convergence import Acceleration, TerminationReason
from orip.adjustment.equations import Equations, Linearised, OtherPlace, Problem, StateT
from orip.adjustment.exchanges import (
    Exchange,
    are_few,
    exchanges_to_try,
    lost_by_themselves,
    wrong_by_themselves,
    wrong_one_by_one,
)
from orip.adjustment.iteration_state import Candidate, IterationSettings, IterationState, Tried
from orip.adjustment.normals import SolvedNormals, solve_normals
from orip.adjustment.relocations import changed_weights, relocations
from orip.adjustment.sparse_rows import SparseRows
from orip.adjustment.weight_changes import HIDDEN, LEAST_GAIN, are_many
from orip.adjustment.weight_search import MOST_ROUNDS
from orip.arrays import BoolArray, FloatArray, IntArray
from orip.structs import replace

_LONGEST_ATTEMPT = 8
"""Iterations after which an attempt at a better solution is given up."""

_FAR = 40.0
"""Parts of the limit from which a residual is too far off for linear theory."""

_MOST_EXCHANGES = 3
"""Exchanges that are tried at one solution."""

_MOST_RELOCATIONS = 6
"""Blocks at other places that are looked at with the linearisation there."""

_MOST_CORRECTIONS = 4
"""Corrections with the same normal equations before an exchange is judged: residuals of hundreds of a-priori errors are
not linear."""

_MOST_TURNS = 8
"""Corrections with the same normal equations in which control that has lost its weight may lead back: without it a
block may have turned by a tenth of a radian."""

_CLEARLY, _MOST_HIGHER = 0.002, 0.05
"""Parts of the square of the limit: by the first the cost is lower where that is certain; an exchange after which it is
higher by less than the second is tried as well, since the weights of other observations follow."""

_LOWER = 1e-6
"""Part of the cost by which that of a better solution is lower: less is within the accuracy of converged ones."""


def next_attempt(
    problem: Problem[StateT],
    now: IterationState[StateT],
    weights: FloatArray,
    normals: SolvedNormals,
    settings: IterationSettings,
    reason: TerminationReason | None,
) -> tuple[IterationState[StateT], TerminationReason | None]:
    """Return from where to go on trying for a better solution, and why the iterations end if there is nothing to try.

    Before a solution has converged only exchanges that lower the cost clearly are tried. `weights` (n,) are those of
    the normal equations, which led to where the iterations are.
    """
    tried, equations, limit = now.tried, now.current.equations, now.weighing.final_limit
    # one iteration is left for the way back
    if settings.start_down_weight is None or len(now.records) + 2 > settings.max_iterations:
        return now, reason
    if tried.attempts >= settings.most_attempts or not _reduced(now).any():
        return now, reason
    if tried.exchanges is None and (reason is not None or not now.weighing.of_tracks):
        tried = replace(tried, exchanges=_candidates(problem, now, weights, normals, settings.max_lost_digits))
    if tried.exchanges and (reason is not None or tried.exchanges[0].is_lower):
        candidate, *others = tried.exchanges
        beginning = Linearised(candidate.state, problem.linearise(candidate.state))
        return _attempt(now, beginning, replace(tried, exchanges=tuple(others)), reason, candidate), None
    if reason is not None and not tried.consensus:
        tried = replace(tried, consensus=True)
        state = problem.improve_consensus(now.current.state, equations, limit)
        moved = None if state is None else Linearised(state, problem.linearise(state))
        if moved is not None and _may_be_lower(moved.equations, now):
            return _attempt(now, moved, tried, reason), None
    if reason is not None and not (tried.hidden or now.weighing.of_tracks):
        found = _hidden(problem, now, weights, normals)
        return next_attempt(
            problem,
            replace(now, tried=replace(tried, exchanges=found, hidden=True)),
            weights,
            normals,
            settings,
            reason,
        )
    return replace(now, tried=tried), reason


def _may_be_lower(there: Equations, now: IterationState[StateT]) -> bool:
    """Return whether an attempt may end at a lower cost; of tracks, where all other points follow, any one may."""
    most = _cost(now) + _MOST_HIGHER * now.weighing.final_limit**2
    return now.weighing.of_tracks or now.weighing.cost(there) < most


def _candidates(
    problem: Problem[StateT],
    now: IterationState[StateT],
    weights: FloatArray,
    normals: SolvedNormals,
    max_lost_digits: float,
) -> tuple[Candidate[StateT], ...]:
    """Return where exchanges and relocations lead that lower the robust cost, or may lower it, the lowest first."""
    limit = now.weighing.final_limit
    # the same design matrix serves all of them
    equations = replace(now.current.equations, rows=SparseRows(now.current.equations.design))
    singly = wrong_by_themselves(equations, weights)
    lost = lost_by_themselves(equations, weights, problem.layout, singly)
    if not now.weighing.of_tracks:
        singly |= wrong_one_by_one(equations, weights, limit)
    may_be_exchanged = bool((singly & (weights < 1.0)).any())
    places = _places(problem, now, weights)
    if not places and not may_be_exchanged and not len(lost):
        return ()
    bound = normals.with_constraints(equations)
    found = []
    if may_be_exchanged:
        rounds = rounds_after(now.tried.attempts)
        for exchange in exchanges_to_try(equations, weights, bound, problem.layout, limit, singly, rounds):
            found += _where_it_leads(problem, now, exchange, equations, weights, bound)
    if len(lost) and not are_few(equations, weights):
        found += _taken_back(problem, now, lost, equations, weights, max_lost_digits)
    if places:
        found += _relocated(problem, now, weights, equations, bound, places)
    return tuple(candidate for _, candidate in sorted(found, key=itemgetter(0))[:_MOST_EXCHANGES])


def _hidden(
    problem: Problem[StateT], now: IterationState[StateT], weights: FloatArray, normals: SolvedNormals
) -> tuple[Candidate[StateT], ...]:
    """Return where exchanges lead with which observations lose their weight that hide behind others."""
    limit = now.weighing.final_limit
    equations = replace(now.current.equations, rows=SparseRows(now.current.equations.design))
    among = wrong_one_by_one(equations, weights, limit) | wrong_by_themselves(equations, weights)
    if not are_many(weights[among], equations.residual[among], limit):
        return ()
    among &= (weights >= 1.0) | (np.abs(equations.residual) < _FAR * limit)
    bound, found = normals.with_constraints(equations), []
    for exchange in exchanges_to_try(equations, weights, bound, problem.layout, limit, among, thresholds=HIDDEN):
        found += _where_it_leads(problem, now, exchange, equations, weights, bound)
    lower = sorted((one for one in found if one[0] < _cost(now) - LEAST_GAIN * limit**2), key=itemgetter(0))
    return tuple(candidate for _, candidate in lower[:_MOST_EXCHANGES])


def rounds_after(attempts: int) -> int:
    """Return how often changes of weights may begin again in the search for exchanges after so many attempts.

    Where one better solution after the other is found, what linear theory promises does not come true, as in a block
    whose photo has the wrong camera: the search would take most of the time of its adjustment.
    """
    return max(MOST_ROUNDS // (1 + attempts), 1)


def _where_it_leads(
    problem: Problem[StateT],
    now: IterationState[StateT],
    exchange: Exchange,
    equations: Equations,
    weights: FloatArray,
    normals: SolvedNormals,
) -> list[tuple[float, Candidate[StateT]]]:
    """Return the cost and the state that an exchange leads to by a few corrections; none where the cost is higher."""
    limit, known = now.weighing.final_limit, _cost(now)
    moved, cost = now.current, np.inf
    for _ in range(_MOST_CORRECTIONS):
        correction = exchange.correction(moved.equations.residual, equations, weights, normals)
        state, before = problem.update(moved.state, correction), cost
        moved = Linearised(state, problem.linearise(state))
        if not np.isfinite(moved.equations.residual).all():  # a residual without bound has the cost of any wrong one
            return []
        cost = now.weighing.cost(moved.equations)
        if cost > before - _CLEARLY * limit**2 or cost < known:
            break
    if cost >= known + _MOST_HIGHER * limit**2:
        return []
    is_lower = cost < known - _CLEARLY * limit**2
    return [(cost, Candidate(moved.state, exchange.full_weight, exchange.no_weight, is_lower))]


def _taken_back(
    problem: Problem[StateT],
    now: IterationState[StateT],
    lost: IntArray,
    equations: Equations,
    weights: FloatArray,
    max_lost_digits: float,
) -> list[tuple[float, Candidate[StateT]]]:
    """Return the cost and the state with the weight of all observations `lost` given back; none where it is not lower.

    Control that has lost its weight may leave the rest undetermined, and cofactors tell nothing then: normal equations
    are formed with it. The rest may have turned far away.
    """
    limit, known, back = now.weighing.final_limit, _cost(now), weights.copy()
    back[lost] = 1.0
    normals = solve_normals(equations, back, problem.layout, max_lost_digits).with_constraints(equations)
    moved = now.current
    for _ in range(_MOST_TURNS):
        weighted = equations.effective(back) * moved.equations.residual
        correction = -normals.solve((equations.design.T @ weighted)[:, None])[:, 0]
        state = problem.update(moved.state, correction)
        moved = Linearised(state, problem.linearise(state))
        if not moved.equations.active[equations.active].all():
            break  # points have come behind photos: the corrections diverge
        cost = now.weighing.cost(moved.equations)
        if cost < known:
            is_lower = cost < known - _CLEARLY * limit**2
            return [(cost, Candidate(state, lost, np.zeros(0, dtype=np.intp), is_lower))]
    return []


def _places(problem: Problem[StateT], now: IterationState[StateT], weights: FloatArray) -> Sequence[OtherPlace]:
    """Return places to which blocks may be moved: of tracks, where observations are wrong as wholes, or one by one."""
    equations, limit = now.current.equations, now.weighing.final_limit
    if now.weighing.of_tracks:
        return problem.rival_places(now.current.state, equations, weights, limit)
    return problem.other_places(now.current.state, equations, weights, limit) if are_few(equations, weights) else ()


def _relocated(
    problem: Problem[StateT],
    now: IterationState[StateT],
    weights: FloatArray,
    equations: Equations,
    normals: SolvedNormals,
    places: Sequence[OtherPlace],
) -> list[tuple[float, Candidate[StateT]]]:
    """Return costs and states with blocks at other places, and with all of them there by which the cost falls."""
    limit = now.weighing.final_limit
    grouped = equations.with_wider_groups() if now.weighing.of_tracks else equations
    found = relocations(places, grouped, weights, normals, problem.layout, limit)
    tried = [[one] for one in found.by_cost(limit**2)[:_MOST_RELOCATIONS]]
    if len(several := found.of_different_blocks(-_CLEARLY * limit**2)) > 1:
        tried.append(several)
    # what the iterations would gain without them does not count
    as_is = problem.update(now.current.state, found.remaining)
    known = min(_cost(now), now.weighing.cost(problem.linearise(as_is)))
    ends = []
    for relocated in tried:
        state = problem.update(now.current.state, found.correction(relocated))
        cost = now.weighing.cost(problem.linearise(state))
        if cost < known + _CLEARLY * limit**2:
            full, none = changed_weights(relocated, weights)
            ends.append((cost, Candidate(state, full, none, cost < known - _CLEARLY * limit**2)))
    return ends


def _attempt(
    before: IterationState[StateT],
    beginning: Linearised[StateT],
    tried: Tried[StateT],
    reason: TerminationReason | None,
    exchange: Candidate[StateT] | None = None,
) -> IterationState[StateT]:
    """Return the state at which an attempt begins; it knows the solution to which it may have to go back."""
    tried = replace(tried, attempts=tried.attempts + 1)
    known = replace(before, tried=tried, had_converged=reason is TerminationReason.CONVERGED)
    return replace(
        before, current=beginning, acceleration=Acceleration(), tried=tried, exchange=exchange, attempted_from=known,
        had_converged=False,
    )  # fmt: skip


def judged_attempt(
    now: IterationState[StateT],
    before: IterationState[StateT],
    reason: TerminationReason | None,
    settings: IterationSettings,
    *,
    settled: bool,
) -> tuple[IterationState[StateT], TerminationReason | None]:
    """Return where to go on during an attempt, and why the iterations end: a solution that is no better is left.

    `settled` tells that it is known which observations have lost weight. A solution that had converged is only left for
    another one that has.
    """
    is_lower = _cost(now) < (1.0 - _LOWER) * _cost(before)
    used_up = _is_used_up(now, before, settings)
    is_better = is_lower and not before.had_converged and (settled or used_up)
    if (reason is TerminationReason.CONVERGED and is_lower) or (reason is None and is_better):
        return replace(now, attempted_from=None, tried=Tried(now.tried.attempts)), reason
    if reason is None and not used_up and not (settled and _leads_nowhere(now, before)):
        return now, None
    stopped = TerminationReason.STOPPED if reason is TerminationReason.STOPPED else None
    return replace(before, tried=now.tried, records=now.records), stopped


def _is_used_up(now: IterationState[StateT], before: IterationState[StateT], settings: IterationSettings) -> bool:
    taken = len(now.records) - len(before.records)
    return taken >= _LONGEST_ATTEMPT or len(now.records) + 1 >= settings.max_iterations


def _leads_nowhere(now: IterationState[StateT], before: IterationState[StateT]) -> bool:
    """Return whether an attempt ends where it began, or at a higher cost.

    The cost falls by half the square of a correction in units of its standard deviations, and by what the corrections
    that follow add to that: where these shrink by 0.7 each time, by as much again.
    """
    still_to_fall = now.control.unknowns * 10.0 ** (-2.0 * now.records[-1].enp)
    is_back = np.array_equal(_reduced(now), _reduced(before)) and np.array_equal(
        now.current.equations.active, before.current.equations.active
    )
    return is_back or _cost(now) - still_to_fall > _cost(before)


def _cost(state: IterationState[StateT]) -> float:
    return state.weighing.cost(state.current.equations)


def _reduced(state: IterationState[StateT]) -> BoolArray:
    """Return which observations (n,) have lost weight."""
    equations = state.current.equations
    return np.asarray(equations.active & (state.weighing.factors(equations, len(state.records) + 1) < 1.0))
