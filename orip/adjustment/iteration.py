"""The iterations: linearise, weigh, solve, control the step, move, judge convergence.

Gauss-Newton, with damping (Marquardt 1963) where the full correction fails, and weights of the Danish method.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Generic, NamedTuple

import numpy as np

from orip.adjustment.acceleration import Acceleration
from orip.adjustment.block_fit import with_blocks_fitted
from orip.adjustment.convergence import (
    TerminationReason,
    exponent_of_numerical_precision,
    is_diverging,
    most_are_lost,
    weights_are_steady,
)
from orip.adjustment.equations import Equations, Layout, Linearised, Problem, StateT
from orip.adjustment.final_weights import Restoration, improve
from orip.adjustment.normals import SolvedNormals, solve_normals
from orip.adjustment.step_control import StepControl
from orip.adjustment.weighing import Weighing, weighing_from
from orip.arrays import FloatArray

_IMPROVABLE_ENP = 2.0
"""ENP from which corrections no longer change which observations may regain full weight."""

_SAME_PLACE_ENP = 3.0
"""ENP from which normal equations need not be formed again at the final state: corrections are a thousandth of the
standard deviations, and change partials by less than the rounding of printed figures."""


@dataclass(frozen=True, slots=True)
class IterationSettings:
    """What controls the iterations.

    Parameters
    ----------
    enp_stop : float
    max_iterations : int
    max_standard_residual : float
        Above it the Danish method reduces a weight.
    start_down_weight : int or None
        First iteration in which it may; None: all weights are 1.
    max_lost_digits : float
    early_weights : bool
        Exceptionally large residuals lose weight before the Danish method, which waits until the block has settled;
        else all weights are 1 before it, and it begins at `start_down_weight`.
    """

    enp_stop: float
    max_iterations: int
    max_standard_residual: float
    start_down_weight: int | None
    max_lost_digits: float
    early_weights: bool = True


@dataclass(frozen=True, slots=True)
class IterationRecord:
    """One printed line: see `orip.records.solution.IterationPass`; sigma0 is that after the iteration.

    `active` is the number of observations that can be computed.
    """

    iteration: int
    enp: float
    sigma0: float
    down_weighted: int
    singular: int
    step_limited: bool
    active: int


@dataclass(frozen=True, slots=True)
class Adjustment(Generic[StateT]):
    """The end of the iterations.

    Parameters
    ----------
    state : state of the problem
    equations : Equations
        At that state.
    weight_factors : array (n,)
        Those of the final state; 0 for observations that take no part.
    normals : SolvedNormals
        Factored with the final weights. They and the rows of the equations belong to the final state, or to the one
        before the last iteration where that one changed next to nothing.
    iterations : tuple of IterationRecord
    reason : TerminationReason
    """

    state: StateT
    equations: Equations
    weight_factors: FloatArray
    normals: SolvedNormals
    iterations: tuple[IterationRecord, ...]
    reason: TerminationReason


@dataclass(frozen=True, slots=True)
class _IterationState(Generic[StateT]):
    """All that one iteration hands to the next.

    Parameters
    ----------
    current : Linearised
        The state with its observation equations.
    weighing : Weighing
    control : StepControl
    acceleration : Acceleration
    restoration : Restoration
    last : int
        Number of the last iteration allowed.
    full_weight : int or None
        The observation to which the next iteration restores full weight.
    records : tuple of IterationRecord
        Of the iterations so far.
    """

    current: Linearised[StateT]
    weighing: Weighing
    control: StepControl
    acceleration: Acceleration
    restoration: Restoration
    last: int
    full_weight: int | None = None
    records: tuple[IterationRecord, ...] = ()


class _Step(NamedTuple, Generic[StateT]):
    """A step that was taken: its normal equations, where it began and ended, and what it leaves to the next one."""

    normals: SolvedNormals
    before: Equations
    moved: Linearised[StateT]
    limited: bool
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

    Returns
    -------
    Adjustment
    """
    now = _initial(problem, start, settings)
    while True:
        weights = _weights(now)
        step = _controlled_step(problem, now, weights, settings)
        now = _after(now, step, weights, problem.layout)
        on_iteration(now.records[-1])
        next_weights = now.weighing.factors(now.current.equations, len(now.records) + 1)
        steady = weights_are_steady(weights, next_weights)
        if not steady or _has_exact_constraints(now.current.equations):
            now = replace(now, acceleration=Acceleration())
        reason = _termination_reason(now, settings, steady=steady, stop_asked=stop_asked())
        if reason in (None, TerminationReason.CONVERGED) and steady and now.records[-1].enp >= _IMPROVABLE_ENP:
            now, improved = _improved(problem, now, next_weights, step.normals, settings)
            reason = None if improved else reason
        if reason is None and len(now.records) >= now.last:
            reason = TerminationReason.MAX_ITERATIONS
        if reason is not None:
            break
        # the normal equations of the next iteration need their memory
        del step
    final = _final_weights(now)
    equations, normals = now.current.equations, None
    if now.records[-1].enp >= _SAME_PLACE_ENP and np.array_equal(_effective(step.before, weights), final):
        equations, normals = replace(equations, rows=step.before.rows), step.normals
    del step
    if normals is None:
        normals = solve_normals(equations, final, problem.layout, settings.max_lost_digits)
    return Adjustment(now.current.state, equations, final, normals, now.records, reason)


def _initial(problem: Problem[StateT], start: StateT, settings: IterationSettings) -> _IterationState[StateT]:
    return _IterationState(
        _linearised(problem, start),
        weighing_from(settings.max_standard_residual, settings.start_down_weight, early=settings.early_weights),
        StepControl(problem.layout.unknowns),
        Acceleration(),
        Restoration(),
        settings.max_iterations,
    )


def _linearised(problem: Problem[StateT], state: StateT) -> Linearised[StateT]:
    return Linearised(state, problem.linearise(state))


def _weights(now: _IterationState[StateT]) -> FloatArray:
    """Return the weight factors (n,) of the next iteration."""
    weights = now.weighing.factors(now.current.equations, len(now.records) + 1)
    if now.full_weight is not None:
        weights[now.full_weight] = 1.0
    return weights


def _controlled_step(
    problem: Problem[StateT], now: _IterationState[StateT], weights: FloatArray, settings: IterationSettings
) -> _Step[StateT]:
    """Solve and move; while that fails, fit the blocks by themselves, then damp the correction more and more."""
    before, control = now.current.equations, now.control
    while True:
        normals = solve_normals(before, weights, problem.layout, settings.max_lost_digits, control.damping)
        control = control.judging(before, weights, normals)
        accelerated = (Acceleration() if control.damping else now.acceleration).step(normals, problem.layout)
        factor = problem.step_factor(accelerated.step)
        step = factor * accelerated.step
        moved = _linearised(problem, problem.update(now.current.state, step))
        if not control.damping:
            if control.accepts_correction(before, moved.equations, weights, normals):
                history = accelerated.history.applied(step)
                return _Step(normals, before, moved, factor < 1.0, control.relaxed(), history)
            control = control.refused()
            if control.is_far(normals):
                moved = _linearised(problem, problem.with_blocks_recomputed(moved.state))
        moved = with_blocks_fitted(problem, moved, before, weights)
        if control.accepts_fitted(before, moved.equations, weights, normals):
            return _Step(normals, before, moved, True, control.relaxed(), Acceleration())
        control = control.refused().strengthened()
        # the next attempt needs their memory
        del normals, moved


def _after(
    now: _IterationState[StateT], step: _Step[StateT], weights: FloatArray, layout: Layout
) -> _IterationState[StateT]:
    """Return what an iteration leaves to the next."""
    record = _record(len(now.records) + 1, step, weights, layout)
    return replace(
        now,
        current=step.moved,
        weighing=now.weighing.after(record.iteration, record.enp),
        control=step.control,
        acceleration=step.acceleration,
        full_weight=None,
        records=(*now.records, record),
    )


def _record(iteration: int, step: _Step[StateT], weights: FloatArray, layout: Layout) -> IterationRecord:
    equations, normals = step.moved.equations, step.normals
    singular = int(np.count_nonzero(normals.removed))
    effective = layout.unknowns - singular
    full = equations.active & (weights >= 1.0)
    # while iterating a down-weighted observation counts as not redundant; the final figure has the part of each one
    redundancy = max(int(np.count_nonzero(full)) - effective, 0)
    square_sum = float(np.sum(equations.residual[full & ~equations.exact] ** 2))
    return IterationRecord(
        iteration=iteration,
        enp=exponent_of_numerical_precision(normals.reduced_square_sum, effective),
        sigma0=float(np.sqrt(square_sum / redundancy)) if redundancy else 0.0,
        down_weighted=int(np.count_nonzero(equations.active & (weights < 1.0))),
        singular=singular,
        step_limited=step.limited,
        active=int(np.count_nonzero(equations.active)),
    )


def _termination_reason(
    now: _IterationState[StateT], settings: IterationSettings, *, steady: bool, stop_asked: bool
) -> TerminationReason | None:
    """Return why the iterations end with the last one; None: they go on, if another iteration is allowed."""
    if most_are_lost(now.records[-1].active, now.records[0].active):
        return TerminationReason.DIVERGED
    if steady and _has_converged(now, settings):
        return TerminationReason.CONVERGED
    if stop_asked:
        return TerminationReason.STOPPED
    if _has_diverged(now):
        return TerminationReason.DIVERGED
    return None


def _has_converged(now: _IterationState[StateT], settings: IterationSettings) -> bool:
    """Return whether a full correction with the final weight function was small enough."""
    last = now.records[-1]
    return last.enp >= settings.enp_stop and now.weighing.is_final_in(last.iteration) and not last.step_limited


def _has_diverged(now: _IterationState[StateT]) -> bool:
    # where the Danish method begins, or damping ends, corrections grow once, and that is no divergence
    enps = [record.enp for record in now.records[now.weighing.iterations_before :]]
    return is_diverging(enps[-1 - now.control.undamped :]) or is_diverging([*enps[:1], *enps[-1:]])


def _has_exact_constraints(equations: Equations) -> bool:
    """Return whether equations are shifted after each iteration: corrections then depend on more than the state."""
    return bool((equations.active & equations.exact).any())


def _improved(
    problem: Problem[StateT],
    now: _IterationState[StateT],
    weights: FloatArray,
    normals: SolvedNormals,
    settings: IterationSettings,
) -> tuple[_IterationState[StateT], bool]:
    """Return where to go on from a solution with steady weights, and whether that is another place or weight."""
    if settings.start_down_weight is None:
        return now, False
    limit = settings.max_standard_residual
    improvement, restoration = improve(problem, now.current, weights, normals, limit, now.restoration)
    now = replace(now, restoration=restoration)
    if improvement is None:
        return now, False
    return replace(
        now,
        current=improvement.linearised,
        full_weight=improvement.full_weight,
        acceleration=Acceleration(),
        last=len(now.records) + settings.max_iterations,
    ), True


def _final_weights(now: _IterationState[StateT]) -> FloatArray:
    """Return the weight factors (n,) at the final state."""
    return _effective(now.current.equations, now.weighing.factors(now.current.equations, len(now.records)))


def _effective(equations: Equations, weights: FloatArray) -> FloatArray:
    return np.where(equations.active, weights, 0.0)
