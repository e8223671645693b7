"""The iterations: linearise, weigh, solve, control the step, move, judge convergence.

Gauss-Newton, with damping (Marquardt 1963) where the full correction fails, and weights of the Danish method.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Generic, NamedTuple

import numpy as np
from msgspec import Struct

from orip.adjustment.convergence import (
    Acceleration,
    StepControl,
    TerminationReason,
    exponent_of_numerical_precision,
    is_diverging,
    judged_residuals,
    most_are_lost,
    weights_are_steady,
    with_blocks_fitted,
)
from orip.adjustment.equations import Equations, Layout, Linearised, Problem, StateT
from orip.adjustment.improvement import judged_attempt, next_attempt
from orip.adjustment.iteration_state import FormedNormals, IterationRecord, IterationSettings, IterationState, will_do
from orip.adjustment.normals import SolvedNormals, solve_normals
from orip.adjustment.precision import cofactors
from orip.adjustment.weights import SETTLED_ENP, Weighing, has_many_reduced, sums_of_full_weight, weighing_from
from orip.arrays import BoolArray, FloatArray
from orip.set_aside import set_aside
from orip.structs import replace

_SAME_COST_ENP = 2.0
"""ENP from which a correction changes the robust cost by less than what rounding and acceleration make of it."""

_REWEIGHTED_ENP = 0.0
"""ENP from which the residuals reflect an exchange, so that weights may be recomputed."""


class Adjustment(Struct, Generic[StateT], frozen=True):
    """The end of the iterations.

    Parameters
    ----------
    state : state of the problem
    equations : Equations
        At that state.
    weight_factors : array (n,)
        Those of the final state; 0 for observations that take no part.
    normals : SolvedNormals
        Factored with the final weights.
    linearised_at : state of the problem
        Of normal equations and rows: the final one, or one before last iterations that changed next to nothing.
    iterations : tuple of IterationRecord
    reason : TerminationReason
    weighing : Weighing
        Of the final weights.
    """

    state: StateT
    equations: Equations
    weight_factors: FloatArray
    normals: SolvedNormals
    linearised_at: StateT
    iterations: tuple[IterationRecord, ...]
    reason: TerminationReason
    weighing: Weighing

    @property
    def scale(self) -> float:
        """Return the scale of the observations, in a-priori errors, that weights were reduced by."""
        return self.weighing.scale

    @property
    def robust_cost(self) -> float:
        """Return what the final weights make least; see `Weighing.cost`."""
        return self.weighing.cost(self.equations)


class _Step(NamedTuple, Generic[StateT]):
    """A step that was taken: its normal equations, where it began and ended, and what it leaves to the next one."""

    formed: FormedNormals[StateT]
    before: Linearised[StateT]
    moved: Linearised[StateT]
    limited: bool
    damped: bool
    control: StepControl
    acceleration: Acceleration


def adjust(
    problem: Problem[StateT],
    start: StateT,
    settings: IterationSettings,
    on_iteration: Callable[[IterationRecord], None],
    stop_asked: Callable[[], bool],
) -> Adjustment[StateT]:
    """Iterate from a starting state to the least-squares solution.

    Parameters
    ----------
    problem : Problem
    start : state of the problem
    settings : IterationSettings
    on_iteration : callable
        Called with the record of each iteration.
    stop_asked : callable
        Asked after each iteration; True ends the iterations with the current state.
    """
    now = _initial(problem, start, settings)
    reason: TerminationReason | None = None
    held: FormedNormals[StateT] | None = None
    while reason is None:
        now, formed = _determined(problem, now, settings, held)
        step = _controlled_step(problem, now, formed, settings)
        del formed, held
        weights = step.formed.weights
        now = _after(now, step, weights, problem.layout, settings)
        on_iteration(now.records[-1])
        if now.weighing.settled_after == len(now.records):
            now = _settled(problem, now, step.formed.normals, weights)
        next_weights = now.weighing.factors(now.current.equations, len(now.records) + 1)
        steady = weights_are_steady(weights, next_weights)
        if not steady or now.current.equations.has_exact_constraints:
            now = replace(now, acceleration=Acceleration())
        reason = _termination_reason(now, step.before.equations, settings, steady=steady, stop_asked=stop_asked())
        now, reason = _improved(problem, now, step, weights, settings, reason, settled=steady and _is_settled(now))
        if reason is None and len(now.records) >= settings.max_iterations:
            reason = TerminationReason.CONVERGED if now.had_converged else TerminationReason.MAX_ITERATIONS
        if reason is None:
            goes_on = now.current is step.moved and not step.limited
            serves = goes_on and step.formed.have_weights(now.current.equations, next_weights)
            held = step.formed if serves and will_do(step.formed, now.records, settings.enp_stop) else None
            del step  # the next normal equations need its memory
    equations, linearised_at, normals = now.current.equations, now.current.state, None
    final = set_aside(equations.effective(now.weighing.factors(equations, len(now.records))))
    is_full = now.current is step.moved and not step.damped
    if is_full and step.formed.are_of_solution(now.records) and step.formed.have_weights(equations, final):
        equations = replace(equations, rows=step.formed.at.equations.rows)
        linearised_at, normals = step.formed.at.state, step.formed.normals
    del step
    normals = normals or solve_normals(equations, final, problem.layout, settings.max_lost_digits)
    return Adjustment(now.current.state, equations, final, normals, linearised_at, now.records, reason, now.weighing)


def _improved(
    problem: Problem[StateT],
    now: IterationState[StateT],
    step: _Step[StateT],
    weights: FloatArray,
    settings: IterationSettings,
    reason: TerminationReason | None,
    *,
    settled: bool,
) -> tuple[IterationState[StateT], TerminationReason | None]:
    """Return where to go on, and why the iterations end, after what was tried, or is to be tried, for a lower cost."""
    if now.attempted_from is not None:
        now, reason = judged_attempt(now, now.attempted_from, reason, settings, settled=settled)
    goes_on = now.attempted_from is None and now.current is step.moved
    if not (settled and goes_on and reason in (None, TerminationReason.CONVERGED)):
        return now, reason
    if now.weighing.is_scale_in_doubt:
        before = now.weighing.scale
        now = _rescaled(problem, now, step.formed.normals, weights, weights >= 1.0)
        if now.weighing.scale != before:
            return now, None
    return next_attempt(problem, now, weights, step.formed.normals, settings, reason)


def _initial(problem: Problem[StateT], start: StateT, settings: IterationSettings) -> IterationState[StateT]:
    return IterationState(
        _linearised(problem, start),
        weighing_from(settings.max_standard_residual, settings.start_down_weight, early=settings.early_weights),
        StepControl(problem.layout.unknowns),
        Acceleration(),
    )


def _linearised(problem: Problem[StateT], state: StateT) -> Linearised[StateT]:
    return Linearised(state, problem.linearise(state))


def _determined(
    problem: Problem[StateT],
    now: IterationState[StateT],
    settings: IterationSettings,
    held: FormedNormals[StateT] | None,
) -> tuple[IterationState[StateT], FormedNormals[StateT]]:
    """Return the normal equations of the next iteration, without blocks that nothing determines.

    `held` are those of the iteration before, if they will do.
    """
    while True:
        equations, iteration = now.current.equations, len(now.records) + 1
        weights = now.weighing.factors(equations, iteration)
        if now.exchange is not None:
            weights = now.exchange.applied(weights)
        if held is not None and held.have_weights(equations, weights):
            return now, held.solved_again(equations, problem.layout)
        normals = solve_normals(equations, weights, problem.layout, settings.max_lost_digits, now.control.damping)
        formed = FormedNormals(now.current, normals, weights)
        if not now.weighing.is_crowded_in(iteration, equations, weights):
            return now, formed
        scale = now.weighing.scale_in(equations, iteration)
        if now.weighing.has_begun_in(iteration):
            fits = weights if now.weighing.of_tracks else np.ones(len(weights))
            fewer = problem.without_contradictory_blocks(now.current.state, normals.blocks, scale, fits)
        else:
            fewer = problem.without_undetermined_blocks(now.current.state, normals.blocks, scale)
        if fewer is None:
            return now, formed
        del normals, formed
        now = replace(now, current=_linearised(problem, fewer), acceleration=Acceleration())


def _controlled_step(
    problem: Problem[StateT],
    now: IterationState[StateT],
    formed: FormedNormals[StateT],
    settings: IterationSettings,
) -> _Step[StateT]:
    """Move by the solution; while that fails, fit the blocks by themselves, then damp the correction more and more."""
    before, control, weights = now.current.equations, now.control, formed.weights
    while True:
        normals = formed.normals
        control = control.judging(before, weights, normals)
        accelerated = (Acceleration() if control.damping else now.acceleration).step(normals, problem.layout)
        factor = problem.step_factor(accelerated.step)
        step = factor * accelerated.step
        moved = _linearised(problem, problem.update(now.current.state, step))
        if now.weighing.has_begun_with_tracks_in(len(now.records) + 1):
            # weights and residuals of a block change each other slowly; the block by itself is solved quickly
            moves = problem.moves_to_steady_weights(moved.state, moved.equations, now.weighing.final_limit)
            step, moved = step + moves, _linearised(problem, problem.update(moved.state, moves))
        if not control.damping:
            if _is_accepted(now, weights, normals, moved.equations, control.accepts_correction):
                history = accelerated.history.applied(step)
                return _Step(formed, now.current, moved, factor < 1.0, False, control.relaxed(), history)
            control = control.refused()
            if control.is_far(normals):
                moved = _linearised(problem, problem.with_blocks_recomputed(moved.state))
        moved = with_blocks_fitted(problem, moved, before, weights)
        accepted = _is_accepted(now, weights, normals, moved.equations, control.accepts_fitted)
        if accepted or not control.can_damp_more:
            damped = control.damping > 0.0
            return _Step(formed, now.current, moved, True, damped, control.relaxed(), Acceleration())
        control = control.refused().strengthened()
        # the next attempt needs their memory
        del normals, moved, formed
        normals = solve_normals(before, weights, problem.layout, settings.max_lost_digits, control.damping)
        formed = FormedNormals(now.current, normals, weights)


def _is_accepted(
    now: IterationState[StateT],
    weights: FloatArray,
    normals: SolvedNormals,
    after: Equations,
    by_square_sum: Callable[[Equations, Equations, FloatArray, SolvedNormals], bool],
) -> bool:
    """Return whether a step is taken: judged by the robust cost where many weights are reduced, else by square sums.

    A block that is thrown far away by a few wrong observations raises square sums without limit, and the robust cost by
    what these observations cost at most. With exchanged weights a step raises the cost at first.
    """
    before, iteration = now.current.equations, len(now.records) + 1
    enp = exponent_of_numerical_precision(normals.reduced_square_sum, now.control.unknowns)
    if now.exchange is not None or not has_many_reduced(before, weights):
        return by_square_sum(before, after, weights, normals)
    here = now.weighing.cost_in(before, iteration, before.residual)
    return enp >= _SAME_COST_ENP or now.weighing.cost_in(before, iteration, judged_residuals(before, after)) <= here


def _after(
    now: IterationState[StateT], step: _Step[StateT], weights: FloatArray, layout: Layout, settings: IterationSettings
) -> IterationState[StateT]:
    """Return what an iteration leaves to the next."""
    is_small = settings.is_small is None or settings.is_small(now.current, step.moved, weights)
    record = replace(_record(len(now.records) + 1, step, weights, layout), is_small=is_small)
    return replace(
        now,
        current=step.moved,
        weighing=now.weighing.after(record.iteration, record.enp, step.moved.equations),
        control=step.control,
        acceleration=step.acceleration,
        exchange=now.exchange if record.enp < _REWEIGHTED_ENP else None,
        records=(*now.records, record),
    )


def _record(iteration: int, step: _Step[StateT], weights: FloatArray, layout: Layout) -> IterationRecord:
    equations, normals = step.moved.equations, step.formed.normals
    singular = int(np.count_nonzero(normals.removed))
    effective = layout.unknowns - singular
    active, full, square_sum = sums_of_full_weight(equations, weights)
    # while iterating a down-weighted observation counts as not redundant; the final figure has the part of each one
    redundancy = max(full - effective, 0)
    return IterationRecord(
        iteration=iteration,
        enp=exponent_of_numerical_precision(normals.reduced_square_sum, effective),
        sigma0=float(np.sqrt(square_sum / redundancy)) if redundancy else 0.0,
        down_weighted=active - full,
        singular=singular,
        step_limited=step.limited,
        active=active,
    )


def _termination_reason(
    now: IterationState[StateT], before: Equations, settings: IterationSettings, *, steady: bool, stop_asked: bool
) -> TerminationReason | None:
    """Return why the iterations end with the last one; None: they go on, if another iteration is allowed."""
    # the first iteration may be the one that loses them: those that are left may determine nothing, and fit
    computable = now.records[-1].active
    if any(
        most_are_lost(computable, at_first)
        for at_first in (int(np.count_nonzero(before.active)), now.records[0].active)
    ):
        return TerminationReason.DIVERGED
    if steady and _has_converged(now, settings):
        return TerminationReason.CONVERGED
    if stop_asked:
        return TerminationReason.STOPPED
    if _has_diverged(now) and now.weighing.cost(now.current.equations) >= now.weighing.cost(before):
        return TerminationReason.DIVERGED
    return None


def _has_converged(now: IterationState[StateT], settings: IterationSettings) -> bool:
    """Return whether a full correction with the final weight function was small enough."""
    last = now.records[-1]
    return last.enp >= settings.enp_stop and last.is_small and _had_final_weights(now)


def _is_settled(now: IterationState[StateT]) -> bool:
    """Return whether it is known which observations the final weight function reduces."""
    return now.records[-1].enp >= SETTLED_ENP and _had_final_weights(now)


def _had_final_weights(now: IterationState[StateT]) -> bool:
    """Return whether the last iteration was a full step with the final weight function."""
    return now.weighing.is_final_in(now.records[-1].iteration) and not now.records[-1].step_limited


def _has_diverged(now: IterationState[StateT]) -> bool:
    # where the Danish method begins, or damping ends, corrections grow once, and that is no divergence
    enps = [record.enp for record in now.records[now.weighing.iterations_before :]]
    return is_diverging(enps[-1 - now.control.undamped :]) or is_diverging([*enps[:1], *enps[-1:]])


def _settled(
    problem: Problem[StateT], now: IterationState[StateT], normals: SolvedNormals, weights: FloatArray
) -> IterationState[StateT]:
    """Return the state as the Danish method begins: with the scale of the observations, and doubtful blocks placed.

    What the iterations before made of points that do not fit depends on where they began.
    """
    equations = now.current.equations
    if not has_many_reduced(equations, weights):
        return _with_all_blocks(problem, now)
    now = replace(now, weighing=now.weighing.with_many_reduced(equations, weights))
    return _rescaled(problem, now, normals, weights, None)


def _rescaled(
    problem: Problem[StateT],
    now: IterationState[StateT],
    normals: SolvedNormals,
    weights: FloatArray,
    among: BoolArray | None,
) -> IterationState[StateT]:
    """Return the state with the scale of some of the observations (n,), and doubtful blocks placed with it.

    With many outliers the residuals are large as long as these have influence. In a solution those of
    observations with full weight show the errors; blocks that were left out with another scale are looked at again.
    """
    equations = now.current.equations
    weighing = now.weighing.scaled(equations, 1.0 - weights * cofactors(equations, normals).leverage, among)
    if among is not None and weighing.scale == now.weighing.scale:
        return replace(now, weighing=weighing)
    current = now.current
    if among is not None:
        current = _linearised(problem, problem.with_all_blocks(current.state))
    state = problem.with_doubtful_blocks_placed(current.state, current.equations, weighing.final_limit)
    return replace(now, current=_linearised(problem, state), weighing=weighing, acceleration=Acceleration())


def _with_all_blocks(problem: Problem[StateT], now: IterationState[StateT]) -> IterationState[StateT]:
    """Return the state with the blocks that were left out while it was still far from the solution."""
    state = problem.with_all_blocks(now.current.state)
    if state is now.current.state:
        return now
    return replace(now, current=_linearised(problem, state), acceleration=Acceleration())
