"""Cholesky factorisation that removes the unknowns that nothing determines.

The digits that a diagonal element loses during the elimination are watched, as Poder did; which unknowns are removed
is decided by movements of small stiffness (`orip.adjustment.factorisation.null_space`), not by single pivots: rounding
leaves a pivot of its own size, magnified, where nothing should be left. A removed unknown has neither row nor column,
and its correction is zero.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_solve, lapack, solve_triangular

from orip.adjustment.factorisation.null_space import SHIFT, RemovedUnknowns, soft_movements, unknowns_to_remove
from orip.arrays import FloatArray, IntArray

_BLOCK = 128
"""Rows and columns copied at once: a square of 128 kB."""

LOST_ALL = 99.0
"""Digits lost by an unknown that no observation touches."""


@dataclass(frozen=True, slots=True)
class Factor:
    """The factor of the columns that are determined.

    Parameters
    ----------
    order : array (k,)
        Columns in the order of their elimination.
    lower : array (k, k)
        L with L L^T = matrix[order][:, order].
    lost_digits : array (m,)
        -log10 of each scaled pivot; of a removed column see `unknowns_to_remove`, `LOST_ALL` without observations.
    removed : array (m,) of bool
        Columns that are not determined.
    """

    order: IntArray
    lower: FloatArray
    lost_digits: FloatArray
    removed: NDArray[np.bool_]

    def reduce(self, right: FloatArray) -> FloatArray:
        """Return c = L^-1 right for right-hand sides (m,) or (m, k).

        The square sum of c is the drop of the weighted square sum.
        """
        return np.asarray(solve_triangular(self.lower, right[self.order], lower=True))

    def back_substitute(self, reduced_right: FloatArray) -> FloatArray:
        """Return the solution (m,) or (m, k) of L^T x = c, zero for removed columns."""
        solution = np.zeros((len(self.removed), *reduced_right.shape[1:]))
        solution[self.order] = solve_triangular(self.lower, reduced_right, lower=True, trans="T")
        return solution

    def inverse(self) -> FloatArray:
        """Return the inverse (m, m), with zero rows and columns for removed columns."""
        size = len(self.removed)
        if not len(self.order):
            return np.zeros((size, size))
        lower, _ = lapack.dpotri(self.lower, lower=1)
        _mirror(lower)
        inverse = np.asarray(lower.T)  # LAPACK has columns where NumPy has rows
        if len(self.order) == size:
            return inverse
        result = np.zeros((size, size))
        result[np.ix_(self.order, self.order)] = inverse
        return result


def _mirror(lower: FloatArray) -> None:
    """Copy a lower triangle to the upper one, block by block: both pass through the cache once, and no copy is made."""
    for start in range(0, len(lower), _BLOCK):
        end = start + _BLOCK
        lower[start:end, end:] = lower[end:, start:end].T
        square = lower[start:end, start:end]
        square[:] = np.tril(square) + np.tril(square, -1).T


def factorise(matrix: FloatArray, max_lost_digits: float, undetermined: NDArray[np.bool_]) -> Factor:
    """Factorise a symmetric positive semidefinite matrix, removing the columns that are not determined.

    Parameters
    ----------
    matrix : array (m, m)
        Scaled so that the diagonal was 1 before any elimination.
    max_lost_digits : float
        A movement whose stiffness has lost more is not determined; a column is removed for it.
    undetermined : array (m,) of bool
        Columns known to have no observation at all; they are removed at once.

    Returns
    -------
    Factor
    """
    removed, lost = undetermined.copy(), np.where(undetermined, LOST_ALL, 0.0)
    if not np.isfinite(matrix).all():
        removed[:], lost[:] = True, LOST_ALL
    while True:
        columns = np.flatnonzero(~removed)
        part = matrix if len(columns) == len(matrix) else matrix[np.ix_(columns, columns)]
        lower = _lower(part)
        found = _undetermined(part, lower, max_lost_digits)
        if lower is not None and not len(found.columns):
            lost[columns] = -2.0 * np.log10(np.diag(lower))
            return Factor(columns, lower, lost, removed)
        removed[columns[found.columns]] = True
        lost[columns[found.columns]] = found.lost_digits


def _lower(matrix: FloatArray, shift: float = 0.0) -> FloatArray | None:
    """Return L of a matrix with its diagonal enlarged, None if it has none."""
    if not len(matrix):
        return matrix
    shifted = matrix + shift * np.eye(len(matrix)) if shift else matrix
    # symmetric, so that its transpose is the same, in LAPACK's order
    lower, info = lapack.dpotrf(shifted.T, lower=1, clean=1)
    return np.asarray(lower) if info == 0 else None


def _undetermined(matrix: FloatArray, lower: FloatArray | None, max_lost_digits: float) -> RemovedUnknowns:
    """Return the columns to remove of a matrix with its factor; without one, at least one column."""
    least, shift = 10.0**-max_lost_digits, SHIFT
    singular = lower is None
    while lower is None:
        lower = _lower(matrix, shift)
        shift *= 10.0
    solver = (lower, True)
    every = np.arange(len(matrix))
    while True:
        found = soft_movements(
            lambda x: matrix @ x, lambda x: np.asarray(cho_solve(solver, x)), every, len(matrix), least
        )
        if len(found.stiffness) or not singular:
            return unknowns_to_remove(found)
        least *= 10.0
