"""The iterations: linearise, weigh, solve, move, until the corrections and the weights have settled."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Generic

import numpy as np

from orip.adjustment.acceleration import Acceleration
from orip.adjustment.block_fit import with_blocks_fitted
from orip.adjustment.convergence import (
    Termination,
    exponent_of_numerical_precision,
    is_diverging,
    weights_are_steady,
)
from orip.adjustment.equations import Equations, Layout, Linearised, Problem, State
from orip.adjustment.normals import SolvedNormals, solve_normals
from orip.adjustment.precision import cofactors
from orip.adjustment.step_control import StepControl
from orip.adjustment.weighing import Weighing
from orip.arrays import FloatArray

_GIVING_BACK_ENP = 2.0
"""Corrections this far below their deviations change no standard residual enough to matter for giving weight back."""


_LOOKS = 3
"""Times that points are taken to where more of their observations fit."""

_SAME_PLACE_ENP = 3.0
"""Corrections a thousandth of their deviations: they change partials by far less than rounding of what is printed."""

_LEAST_LEFT = 0.5
"""Part of the observations; where fewer can still be computed, what is left is not the block."""


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
        First iteration that may have reduced weights; None: none has.
    max_lost_digits : float
    """

    enp_stop: float
    max_iterations: int
    max_standard_residual: float
    start_down_weight: int | None
    max_lost_digits: float


@dataclass(frozen=True, slots=True)
class PassRecord:
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
class Adjusted(Generic[State]):
    """Where the iterations ended.

    Parameters
    ----------
    linearised : Linearised
        The final state and its observation equations.
    weight_factors : array (n,)
        Those of the final state; 0 for observations that take no part.
    normals : SolvedNormals
        Factored with the final weights at the final state, or, like the rows of its equations, where the last
        iteration began, if it changed next to nothing.
    passes : tuple of PassRecord
    termination : Termination
    """

    linearised: Linearised[State]
    weight_factors: FloatArray
    normals: SolvedNormals
    passes: tuple[PassRecord, ...]
    termination: Termination


def adjust(
    problem: Problem[State],
    start: State,
    settings: IterationSettings,
    on_pass: Callable[[PassRecord], None],
    stop_asked: Callable[[], bool],
) -> Adjusted[State]:
    """Iterate from a starting state to the least-squares solution (Gauss-Newton, damped where that would lead away).

    Parameters
    ----------
    problem : Problem
    start : State
    settings : IterationSettings
    on_pass : callable
        Called with each finished pass.
    stop_asked : callable
        Asked after each pass; True ends the iterations with the state in hand.

    Returns
    -------
    Adjusted
    """
    layout = problem.layout
    current = Linearised(start, problem.linearise(start))
    passes: list[PassRecord] = []
    second_look = _SecondLook(problem, settings)
    again: list[int] = []
    acceleration, control = Acceleration(layout), StepControl(layout)
    last = settings.max_iterations
    weighing = Weighing(settings.max_standard_residual, settings.start_down_weight)
    while True:
        iteration = len(passes) + 1
        weights = weighing.factors(current.equations, iteration)
        weights[again] = 1.0
        before = current.equations
        normals, current, limited = _moved(problem, current, weights, settings, acceleration, control)
        passes.append(_record(iteration, current.equations, weights, normals, layout, limited))
        on_pass(passes[-1])
        weighing.after(iteration, passes[-1].enp)
        next_weights = weighing.factors(current.equations, iteration + 1)
        steady = weights_are_steady(weights, next_weights)
        # equations of constants are shifted after each iteration: their corrections follow from more than the state
        if not steady or (current.equations.active & current.equations.exact).any():
            acceleration.forget()
        ended = _termination(passes, settings, weighing, steady, stop_asked(), control)
        again = []
        if ended in (None, Termination.CONVERGED) and steady and passes[-1].enp >= _GIVING_BACK_ENP:
            found = second_look.at(current, next_weights, normals)
            if found is not None:
                current, again = found
                last = iteration + settings.max_iterations
                acceleration.forget()
                ended = None
        if ended is not None or len(passes) >= last:
            break
        # those of the next iteration need the room
        del normals
    final = np.where(current.equations.active, weighing.factors(current.equations, len(passes)), 0.0)
    if passes[-1].enp >= _SAME_PLACE_ENP and np.array_equal(np.where(before.active, weights, 0.0), final):
        current = Linearised(current.state, replace(current.equations, rows=before.rows))
    else:
        # both at once would take too much room
        del normals, before
        normals = solve_normals(current.equations, final, layout, settings.max_lost_digits)
    return Adjusted(current, final, normals, tuple(passes), ended or Termination.MAX_ITERATIONS)


class _SecondLook(Generic[State]):
    """What is reconsidered once the weights are steady, so that the end state depends less on the start.

    First points that have gone with the wrong ones of their observations, some times; then observations that would fit
    with their full weight, one after the other, each of them once.
    """

    def __init__(self, problem: Problem[State], settings: IterationSettings) -> None:
        self._problem, self._settings = problem, settings
        self._given_back: set[int] = set()
        self._looks = 0

    def at(
        self, current: Linearised[State], weights: FloatArray, normals: SolvedNormals
    ) -> tuple[Linearised[State], list[int]] | None:
        """Return where the iterations go on, and the observations that have full weight there; None if all is well."""
        if self._settings.start_down_weight is None:
            return None
        if self._looks < _LOOKS:
            self._looks += 1
            limit = self._settings.max_standard_residual
            state = self._problem.reconsidered(current.state, current.equations, limit)
            if state is not None:
                return Linearised(state, self._problem.linearise(state)), []
        again = _to_give_back(current.equations, weights, normals, self._settings, self._given_back)
        self._given_back.update(again)
        return (current, again) if again else None


def _to_give_back(
    equations: Equations,
    weights: FloatArray,
    normals: SolvedNormals,
    settings: IterationSettings,
    given_back: set[int],
) -> list[int]:
    """Return the down-weighted observation that would fit best with its full weight, if it would fit at all.

    The weight falls at once from 1 to 0.37, so that iterations can end with an observation on either side; this makes
    the end state the same from different starts. With full weight a standard residual u becomes u / (1 + (1 - wf) h).
    Each observation is given back once.
    """
    reduced = np.flatnonzero(equations.active & (weights < 1.0))
    reduced = np.array([row for row in reduced if int(row) not in given_back], dtype=np.int64)
    if not len(reduced):
        return []
    leverage = cofactors(equations, normals).leverage[reduced]
    with_full_weight = np.abs(equations.residual[reduced]) / (1.0 + (1.0 - weights[reduced]) * leverage)
    best = int(with_full_weight.argmin())
    return [int(reduced[best])] if with_full_weight[best] <= settings.max_standard_residual else []


def _moved(
    problem: Problem[State],
    current: Linearised[State],
    weights: FloatArray,
    settings: IterationSettings,
    acceleration: Acceleration,
    control: StepControl,
) -> tuple[SolvedNormals, Linearised[State], bool]:
    """Return the normal equations of an iteration, where it led to, and whether its step is not the full one."""
    while True:
        damping = control.damping
        normals = solve_normals(current.equations, weights, problem.layout, settings.max_lost_digits, damping)
        if damping:
            acceleration.forget()
        step = acceleration.step(normals)
        factor = problem.step_factor(step)
        moved = _at(problem, problem.update(current.state, factor * step))
        if not damping and control.accepts(current.equations, moved.equations, weights, normals, full=True):
            acceleration.applied(factor * step)
            control.weaken()
            return normals, moved, factor < 1.0
        acceleration.forget()
        if not damping and control.is_far(normals):
            moved = _at(problem, problem.with_points_anew(moved.state))
        moved = with_blocks_fitted(problem, moved, current.equations, weights)
        if control.accepts(current.equations, moved.equations, weights, normals, full=False):
            control.weaken()
            return normals, moved, True
        control.strengthen()
        del normals, moved


def _at(problem: Problem[State], state: State) -> Linearised[State]:
    return Linearised(state, problem.linearise(state))


def _record(
    iteration: int,
    equations: Equations,
    weights: FloatArray,
    normals: SolvedNormals,
    layout: Layout,
    step_limited: bool,
) -> PassRecord:
    effective = layout.unknowns - int(np.count_nonzero(normals.removed))
    enp = exponent_of_numerical_precision(normals.reduced_square_sum, effective)
    full = equations.active & (weights >= 1.0)
    down_weighted = int(np.count_nonzero(equations.active & (weights < 1.0)))
    # while iterating a down-weighted observation counts as not redundant; the final figure knows each one's share
    redundancy = max(int(np.count_nonzero(full)) - effective, 0)
    square_sum = float(np.sum(equations.residual[full & ~equations.exact] ** 2))
    sigma0 = float(np.sqrt(square_sum / redundancy)) if redundancy else 0.0
    singular = int(np.count_nonzero(normals.removed))
    active = int(np.count_nonzero(equations.active))
    return PassRecord(iteration, enp, sigma0, down_weighted, singular, step_limited, active)


def _termination(
    passes: list[PassRecord],
    settings: IterationSettings,
    weighing: Weighing,
    steady: bool,
    stop_asked: bool,
    control: StepControl,
) -> Termination | None:
    last = passes[-1]
    if last.active < _LEAST_LEFT * passes[0].active:
        return Termination.DIVERGED
    final = steady and weighing.had_begun(last.iteration)
    if last.enp >= settings.enp_stop and final and not last.step_limited:
        return Termination.CONVERGED
    if stop_asked:
        return Termination.STOPPED
    # where reduced weights begin, or damping ends, corrections grow once, and that is no divergence
    enps = [record.enp for record in passes[weighing.began_after :]]
    if is_diverging(enps[-1 - control.undamped :]) or is_diverging([*enps[:1], *enps[-1:]]):
        return Termination.DIVERGED
    return None
