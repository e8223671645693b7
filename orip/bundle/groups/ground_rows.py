"""The observation equations on the ground: all but those of photo points, which are many and touch nothing else."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.sparse import csr_array

from orip.arrays import FloatArray, IntArray
from orip.bundle.problem import BlockProblem
from orip.bundle.solve import SolvedBlock, threads_that_pay
from orip.records.observations.observation_kinds import PHOTO_POINT


def ground_design(solved: SolvedBlock, rows: IntArray) -> csr_array:
    """Return rows (k, u) of the design matrix, divided by their a-priori errors; none may be of photo points.

    Parameters
    ----------
    solved : SolvedBlock
    rows : array (k,) of int
        Among all observation equations.
    """
    problem = solved.problem
    others = tuple(kind for kind in problem.observations if kind.rows.kind != PHOTO_POINT)
    numbers, first = [np.zeros(0, dtype=np.int64)], 0
    for kind in problem.observations:
        if kind.rows.kind != PHOTO_POINT:
            numbers.append(first + np.arange(len(kind.rows.error)))
        first += len(kind.rows.error)
    design = BlockProblem(problem.block, problem.unknowns, others).design(solved.state)
    return csr_array(design[np.searchsorted(np.concatenate(numbers), rows)])


def inverse_of(solved: SolvedBlock) -> Callable[[FloatArray], FloatArray]:
    """Return what multiplies right-hand sides (u, j) by the cofactor matrix of all unknowns."""

    def solve(right: FloatArray) -> FloatArray:
        with threads_that_pay(solved.problem):
            return solved.normals.solve(right)

    return solve
