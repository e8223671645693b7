"""Blocks fitted by themselves after a step: embedded point iterations (Jeong, Nistér, Steedly, Szeliski, Kweon 2010).

A correction moves blocks and reduced unknowns along a straight line. Where the observations are strongly non-linear,
some blocks end far from their minimum and make the step fail. With the reduced unknowns held a block depends on its own
observations alone: each has its own small least-squares problem, and its own damping.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from orip.adjustment.equations import BlockNormals, Equations, Layout, Linearised, Problem, StateT
from orip.arrays import FloatArray

_PASSES = 2
_FIRST, _STEP = 1e-2, 10.0
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
    root, lost = np.sqrt(np.where(before.active, weights, 0.0)), _lost(before.residual)
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
        damping = np.where(better, damping / _STEP, np.maximum(_STEP * damping, _FIRST))
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
