"""Cholesky factorisation that removes the unknowns that nothing determines.

The digits that a diagonal element loses during the elimination are watched, as Poder did; which unknowns are removed
is decided by movements of small stiffness (`orip.adjustment.factorisation.null_space`), not by single pivots: rounding
leaves a pivot of its own size, magnified, where nothing should be left. A removed unknown has neither row nor column,
and its correction is zero.
"""

from __future__ import annotations

from functools import partial

import numpy as np
from msgspec import Struct
from scipy.linalg import lapack, solve_triangular

from orip.adjustment.factorisation.null_space import factor_of_determined
from orip.arrays import BoolArray, FloatArray, IntArray

_BLOCK = 128
"""Rows and columns copied at once: a square of 128 kB."""


class Factor(Struct, frozen=True):
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
    removed: BoolArray

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


def factorise(matrix: FloatArray, max_lost_digits: float, undetermined: BoolArray) -> Factor:
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
    return factor_of_determined(
        partial(_factor, matrix),
        matrix.__matmul__,
        lambda: bool(np.isfinite(matrix).all()),
        undetermined,
        max_lost_digits,
    )


def _factor(matrix: FloatArray, removed: BoolArray, lost: FloatArray, shift: float) -> Factor | None:
    """Return the factor of the columns that are not removed, its diagonal enlarged; None if it has none."""
    columns = np.flatnonzero(~removed)
    part = matrix if len(columns) == len(matrix) else matrix[np.ix_(columns, columns)]
    if shift:
        part = part + shift * np.eye(len(part))
    # symmetric, so that its transpose is the same, in LAPACK's order
    lower, info = lapack.dpotrf(part.T, lower=1, clean=1) if len(columns) else (part, 0)
    if info != 0:
        return None
    digits = lost.copy()
    digits[columns] = -2.0 * np.log10(np.diag(lower))
    return Factor(columns, np.asarray(lower), digits, removed.copy())
