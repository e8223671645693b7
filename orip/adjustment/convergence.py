"""Step control, when to stop, and acceleration of slow convergence by the last corrections (Anderson 1965).

A correction that would raise the square sum by far is damped, and blocks are fitted after a step.
"""

from __future__ import annotations

from collections.abc import Sequence
from enum import Enum
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from orip.adjustment.equations import BlockNormals, Equations, Layout, Linearised, Problem, StateT
from orip.adjustment.normals import SolvedNormals
from orip.arrays import FloatArray, parts
from orip.structs import replace
from orip.threads import by_threads

ENP_LIMIT = 15.0
"""Printed for corrections that are zero to working precision."""

_WEIGHT_CHANGE = 0.05

_LEAST_COMPUTABLE = 0.5
"""Diverged once less than this part of the observations can be computed."""

_FALLING_ITERATIONS = 3
_FALLEN_DIGITS = 3.0
"""Diverged once corrections are a thousand times as large as the first ones."""


class TerminationReason(Enum):
    """Why the iterations ended."""

    CONVERGED = "converged"
    MAX_ITERATIONS = "not converged within the allowed iterations"
    DIVERGED = "diverged"
    STOPPED = "stopped by the operator"


def exponent_of_numerical_precision(reduced_square_sum: float, unknowns: int) -> float:
    """Return ENP = -1/2 log10(dx^T N dx / u): the digits by which corrections undercut their standard deviations.

    Parameters
    ----------
    reduced_square_sum : float
        dx^T N dx, the square sum of the reduced right-hand side.
    unknowns : int
        Unknowns that took part.

    Notes
    -----
    Krarup (1982) introduced the measure; the formula is this program's reading of it (docs/decisions).
    """
    if not np.isfinite(reduced_square_sum):
        return -np.inf
    mean = reduced_square_sum / max(unknowns, 1)
    return ENP_LIMIT if mean < 10.0 ** (-2.0 * ENP_LIMIT) else float(-0.5 * np.log10(mean))


def weights_are_steady(before: NDArray[np.float64], after: NDArray[np.float64]) -> bool:
    """Return whether no weight factor changes by more than 0.05 from one iteration to the next."""

    def is_steady(part: slice) -> bool:
        return bool(np.abs(after[part] - before[part]).max() <= _WEIGHT_CHANGE)

    return all(by_threads(is_steady, parts(len(after))))


def is_diverging(enps: Sequence[float]) -> bool:
    """Return whether corrections grow: by the ENP of successive iterations with the same weight function.

    That is where ENP fell in three successive iterations and is negative, is three digits below the first one (or below
    zero), or is not finite. A positive ENP says that corrections are smaller than the standard deviations; it may fall
    for some iterations while weights change from one solution to another.
    """
    if enps and not np.isfinite(enps[-1]):
        return True
    if enps and enps[-1] < min(enps[0], 0.0) - _FALLEN_DIGITS:
        return True
    last = enps[-_FALLING_ITERATIONS - 1 :]
    return len(last) > _FALLING_ITERATIONS and last[-1] < 0.0 and all(b < a for a, b in pairwise(last))


def most_are_lost(computable: int, at_first: int) -> bool:
    """Return whether too few of the observations that could be computed at first can be computed now."""
    return computable < _LEAST_COMPUTABLE * at_first


# Gauss-Newton iterations on large residuals, and reweighted ones, converge linearly: each correction is about the same
# part of the one before. Once corrections are smaller than the standard deviations, the step goes to where the sequence
# of corrections would end. Neither the correction, by which convergence is judged, nor the solution is changed by it.

_MEMORY = 3
_STARTING_ENP = 0.0
_FAST = 1.0
"""Digits that an iteration gains where convergence needs no acceleration."""


class Acceleration(Struct, frozen=True):
    """The corrections of the last iterations and the steps that were taken for them; none after a change of weights.

    Parameters
    ----------
    corrections, steps : tuples of arrays (m + 3 b,)
    enp : float
        Of the last correction.
    """

    corrections: tuple[FloatArray, ...] = ()
    steps: tuple[FloatArray, ...] = ()
    enp: float = -np.inf

    def step(self, normals: SolvedNormals, layout: Layout) -> AcceleratedStep:
        """Return the step to take for the correction of an iteration."""
        correction = normals.correction
        enp = exponent_of_numerical_precision(normals.reduced_square_sum, layout.unknowns)
        slow = self.enp < enp < self.enp + _FAST
        before = self if enp >= _STARTING_ENP and slow else Acceleration()
        corrections = (*before.corrections, correction)[-_MEMORY - 1 :]
        steps = before.steps[-(len(corrections) - 1) :] if len(corrections) > 1 else ()
        history = Acceleration(corrections, steps, enp)
        if not steps:
            return AcceleratedStep(correction, history)
        scale = np.concatenate([normals.scale, np.ones(3 * layout.blocks)])
        changes = np.diff(np.array(corrections), axis=0)
        share, *_ = np.linalg.lstsq((changes * scale).T, correction * scale, rcond=1e-6)
        return AcceleratedStep(np.asarray(correction - share @ (np.array(steps) + changes)), history)

    def applied(self, step: FloatArray) -> Acceleration:
        """Return the history with the step that was taken for its last correction."""
        return replace(self, steps=(*self.steps, step))


class AcceleratedStep(NamedTuple):
    """A step (m + 3 b,), and the history with the correction that it is for."""

    step: FloatArray
    history: Acceleration


# A correction moves blocks and reduced unknowns along a straight line. Where the observations are strongly non-linear,
# some blocks end far from their minimum and make the step fail. With the reduced unknowns held a block depends on its
# own observations alone: each has its own small least-squares problem, and its own damping.

_PASSES = 2
_FIRST_DAMPING, _DAMPING_STEP = 1e-2, 10.0
_LITTLE = 1e-4
"""A further pass is made only if the last one lowered the square sum by at least this part."""
_LEAST_PIVOT = 1e-14
_OUT_OF_SIGHT = 4.0
"""An observation that can no longer be computed counts as this multiple of its former square."""


def with_blocks_fitted(
    problem: Problem[StateT], moved: Linearised[StateT], before: Equations, weights: FloatArray
) -> Linearised[StateT]:
    """Return the state with each block moved towards the least square sum of its own observations.

    Parameters
    ----------
    problem : Problem
    moved : Linearised
        Where a correction has led to.
    before : Equations
        Where it began: observations that can no longer be computed count as in `judged_residuals`.
    weights : array (n,)
        Weight factors of the iteration.
    """
    layout, state = problem.layout, moved.state
    fixed = layout.fixed[layout.reduced :].reshape(-1, 3)
    root, lost = np.sqrt(before.effective(weights)), _lost(before.residual)
    here = _normals(moved.equations, root, lost, layout)
    damping = np.zeros(layout.blocks)
    for _ in range(_PASSES):
        correction = _corrections(here, damping, fixed)
        tried = problem.with_blocks_moved(state, correction)
        there = _normals(problem.linearise(tried), root, lost, layout)
        better = there.square_sums < here.square_sums
        state = problem.with_blocks_moved(state, np.where(np.repeat(better, 3), correction, 0.0))
        if np.sum(here.square_sums - there.square_sums, where=better) < _LITTLE * np.sum(here.square_sums):
            break
        here = BlockNormals(
            np.where(better[:, None, None], there.matrices, here.matrices),
            np.where(np.repeat(better, 3), there.right, here.right),
            np.where(better, there.square_sums, here.square_sums),
        )
        damping = np.where(better, damping / _DAMPING_STEP, np.maximum(_DAMPING_STEP * damping, _FIRST_DAMPING))
    return Linearised(state, problem.linearise(state))


def judged_residuals(before: Equations, after: Equations) -> FloatArray:
    """Return the residuals (n,) after a step, zero for observations that could not be computed before it.

    The square of one that can no longer be computed counts as four times the sum of 1 and its former square, so that
    losing an observation is no improvement.
    """
    judged = np.where(before.active, after.residual, 0.0)
    rows = np.flatnonzero(before.active & ~after.active)
    judged[rows] = _lost(before.residual[rows])
    return judged


def _lost(residual: FloatArray) -> FloatArray:
    """Return what observations that can no longer be computed count as, from their residuals before."""
    return np.sqrt(_OUT_OF_SIGHT * (1.0 + residual**2))


def _corrections(normals: BlockNormals, damping: FloatArray, fixed: NDArray[np.bool_]) -> FloatArray:
    """Return the corrections (3 b,) of blocks whose diagonals are multiplied by 1 + damping (b,)."""
    diagonal = np.einsum("bii->ib", normals.matrices)
    scale = np.where(fixed.T | ~(diagonal > 0.0), 0.0, 1.0 / np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0)))
    right = normals.right.reshape(-1, 3).T * scale
    n10, n20, n21 = (normals.matrices[:, i, j] * scale[i] * scale[j] for i, j in ((1, 0), (2, 0), (2, 1)))
    # L D L^T of a unit diagonal; what has no pivot is not moved
    pivot = 1.0 + damping
    l10, l20 = n10 / pivot, n20 / pivot
    rest = n21 - l20 * n10
    by_1 = _inverse(pivot - l10 * n10)
    l21 = rest * by_1
    by_2 = _inverse(pivot - l20 * n20 - l21 * rest)
    reduced = right[1] - l10 * right[0]
    z = (right[2] - l20 * right[0] - l21 * reduced) * by_2
    y = reduced * by_1 - l21 * z
    x = right[0] / pivot - l10 * y - l20 * z
    return np.asarray((np.stack([x, y, z]) * scale).T.ravel())


def _inverse(pivot: FloatArray) -> FloatArray:
    return np.where(pivot > _LEAST_PIVOT, 1.0 / np.where(pivot > _LEAST_PIVOT, pivot, 1.0), 0.0)


def _normals(after: Equations, root: FloatArray, lost: FloatArray, layout: Layout) -> BlockNormals:
    """Return the normal equations of the blocks; `root` (n,) of the weights, and `lost` (n,) residuals of lost ones."""
    misclosure = -root * np.where(after.active, after.residual, lost)
    return after.rows.block_normals(np.where(after.active, root, 0.0), misclosure, layout)


# Near the solution, where corrections are below their standard deviations, and wherever the full correction succeeds,
# nothing is damped: the iterations are those of Gauss and Newton. Damping multiplies the diagonal of the normal
# equations, points included, by 1 + damping (Marquardt 1963). It changes the way to the minimum, and not the minimum:
# iterations do not end with a damped correction. See docs/decisions/012.

_NEAR_ENP, _FAR_ENP = 1.0, 0.0
_FIRST, _LEAST, _MOST = 1e-3, 1e-10, 1e4
_STEP = 10.0

_WORSE, _WORSE_WITH_LOSS = 1e4, 100.0
"""Multiple of the smallest mean square so far that is accepted after a full correction: along a curved valley it may
rise for some iterations. Less is accepted if observations can no longer be computed."""

_LEAST_SHARE = 0.1
"""Part of the predicted decrease that a full correction must bring after its blocks were fitted."""


class StepControl(Struct, frozen=True):
    """How strongly corrections are damped.

    Parameters
    ----------
    unknowns : int
    damping : float
        Of the next correction; 0: none.
    undamped : int
        Iterations since a correction was last refused; -1: in this one.
    least_mean_square : float
        Smallest weighted mean square of the residuals among the iterations that were judged.
    """

    unknowns: int
    damping: float = 0.0
    undamped: int = 0
    least_mean_square: float = np.inf

    def judging(self, before: Equations, weights: FloatArray, normals: SolvedNormals) -> StepControl:
        """Return the control that judges an attempt from a linearisation: it knows the mean square there."""
        if not self._judges(before, normals):
            return self
        here = _mean_square(before, weights, before.residual)
        return replace(self, least_mean_square=min(self.least_mean_square, here))

    def accepts_correction(
        self, before: Equations, after: Equations, weights: FloatArray, normals: SolvedNormals
    ) -> bool:
        """Return whether a full correction is accepted; it may raise the mean square for a while."""
        if not self._judges(before, normals):
            return True
        left = before.active & after.active
        if most_are_lost(int(np.count_nonzero(left)), int(np.count_nonzero(before.active))):
            return False
        here = _mean_square(before, weights, before.residual)
        lost = (before.active & ~left).any()
        allowed = max((_WORSE_WITH_LOSS if lost else _WORSE) * self.least_mean_square, here)
        return _mean_square(before, weights, judged_residuals(before, after)) <= allowed

    def accepts_fitted(self, before: Equations, after: Equations, weights: FloatArray, normals: SolvedNormals) -> bool:
        """Return whether a correction after which blocks were fitted is accepted; it must lower the mean square."""
        if not self._judges(before, normals):
            return True
        share = 0.0 if self.damping else _LEAST_SHARE
        required = share * normals.reduced_square_sum / _total_weight(before, weights)
        allowed = _mean_square(before, weights, before.residual) - required
        return _mean_square(before, weights, judged_residuals(before, after)) <= allowed

    def is_far(self, normals: SolvedNormals) -> bool:
        """Return whether a correction is so large that points may be anywhere."""
        return self._enp(normals) < _FAR_ENP

    @property
    def can_damp_more(self) -> bool:
        """Return whether more damping may still help."""
        return self.damping < _MOST

    def refused(self) -> StepControl:
        """Return the control after an attempt was refused."""
        return replace(self, undamped=-1)

    def relaxed(self) -> StepControl:
        """Return the control after a step was taken: the next correction is damped less, or not at all."""
        weaker = self.damping / _STEP
        return replace(self, undamped=self.undamped + 1, damping=weaker if weaker >= _LEAST else 0.0)

    def strengthened(self) -> StepControl:
        """Return the control that damps the next attempt more."""
        return replace(self, damping=_STEP * self.damping if self.damping else _FIRST)

    def _judges(self, before: Equations, normals: SolvedNormals) -> bool:
        near = self._enp(normals) >= _NEAR_ENP
        # exact constraints must be met whatever the square sum: their equations say nothing of it
        return not ((near and not self.damping) or self.damping >= _MOST or (before.active & before.exact).any())

    def _enp(self, normals: SolvedNormals) -> float:
        return exponent_of_numerical_precision(normals.reduced_square_sum, self.unknowns)


def _total_weight(before: Equations, weights: FloatArray) -> float:
    return max(float(before.effective(weights).sum()), 1.0)


def _mean_square(before: Equations, weights: FloatArray, residual: FloatArray) -> float:
    """Return the weighted mean square of residuals (n,) of what could be computed before the step."""

    def sums(part: slice) -> tuple[float, float]:
        taken, mine = np.where(before.active[part], weights[part], 0.0), residual[part]
        return float(taken.sum()), float((taken * mine) @ mine)

    total, square_sum = np.sum([(0.0, 0.0), *by_threads(sums, parts(len(residual)))], axis=0)
    return float(square_sum / max(total, 1.0))
