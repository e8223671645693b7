"""The observation equations on the ground: all but those of photo points, which are many and touch nothing else."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.sparse import csr_array

from orip.adjustment.residual_sums import RowsUnderTest
from orip.arrays import FloatArray, IntArray
from orip.bundle.problem import BlockProblem
from orip.bundle.solve import SolvedBlock
from orip.records.observations.observation_kinds import PHOTO_POINT
from orip.threads import limited_threads

_MANY = 8
"""Right-hand sides of which so many times the number makes that of the unknowns: more are likely to come."""

_LARGEST = 4_000_000
"""Numbers that computing the cofactors may take: one for each of the unknowns (c,) and each of the reduced ones."""


def rows_under_test(
    solved: SolvedBlock, rows: IntArray, weight: FloatArray, others_variance: float = 1.0
) -> RowsUnderTest:
    """Return observation equations (k,) with the unknowns that they depend on; none may be of photo points.

    Parameters
    ----------
    solved : SolvedBlock
    rows : array (k,) of int
        Among all observation equations.
    weight, others_variance
        As of `RowsUnderTest`.
    """
    design = _ground_design(solved, rows)
    columns = np.unique(design.indices).astype(np.int64)
    residual, inverse = solved.equations.residual[rows], _inverse_of(solved, columns)
    return RowsUnderTest(csr_array(design[:, columns]), columns, residual, weight, inverse, others_variance)


def _ground_design(solved: SolvedBlock, rows: IntArray) -> csr_array:
    """Return rows (k, u) of the design matrix, divided by their a-priori errors."""
    problem = solved.problem
    others = tuple(kind for kind in problem.observations if kind.rows.kind != PHOTO_POINT)
    numbers, first = [np.zeros(0, dtype=np.int64)], 0
    for kind in problem.observations:
        if kind.rows.kind != PHOTO_POINT:
            numbers.append(first + np.arange(len(kind.rows.error)))
        first += len(kind.rows.error)
    design = BlockProblem(problem.block, problem.unknowns, others).design(solved.state)
    return csr_array(design[np.searchsorted(np.concatenate(numbers), rows)])


def _inverse_of(solved: SolvedBlock, columns: IntArray) -> Callable[[FloatArray], FloatArray]:
    """Return what multiplies right-hand sides (c, j) by the cofactors of some unknowns (c,), in ascending order.

    Where many right-hand sides are asked for, as for tests of single residuals, the cofactors are computed, and kept.
    """
    kept: list[FloatArray] = []
    is_small = len(columns) * len(solved.normals.scale) <= _LARGEST

    def solve(right: FloatArray) -> FloatArray:
        with limited_threads(None):
            if not kept and is_small and _MANY * right.shape[1] > len(columns):
                kept.append(solved.normals.inverse_at(columns))
            return kept[0] @ right if kept else solved.normals.solve_at(columns, right)

    return solve
