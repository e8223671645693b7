"""Cholesky factorisation that watches the digits lost by each diagonal element and removes what is not determined.

A column that has lost more than five digits at its turn is deferred: it is not eliminated but kept as a border. At the
end the deferred columns are eliminated by largest remaining pivot first, and those that lose more digits than allowed
are removed: row and column do not take part, the correction is zero. Monitoring the reduction of the diagonal is
Poder's. The deferral is this program's own, and so is judging a deferred column by its movement (see
`Elimination.digits_of_movement`): both together make a limit of 12 digits right for 16-digit arithmetic.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lapack, solve_triangular

from orip.arrays import FloatArray, IntArray

DEFERRAL_DIGITS = 5.0
LOST_ALL = 99.0
"""Digits lost by a diagonal element that has become zero or negative, or never was positive."""

_PANEL = 64


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
        -log10 of each scaled pivot; `LOST_ALL` where nothing was left.
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
        result = np.zeros((len(self.removed),) * 2)
        if len(self.order):
            inverse, _ = lapack.dpotri(self.lower, lower=1)
            inverse = np.tril(inverse) + np.tril(inverse, -1).T
            result[np.ix_(self.order, self.order)] = inverse
        return result


def factorise(matrix: FloatArray, max_lost_digits: float, undetermined: NDArray[np.bool_]) -> Factor:
    """Factorise a symmetric positive semidefinite matrix, removing the columns that are not determined.

    Parameters
    ----------
    matrix : array (m, m)
        Scaled so that the diagonal was 1 before any elimination.
    max_lost_digits : float
        A column that loses more is removed.
    undetermined : array (m,) of bool
        Columns known to have no observation at all; they are removed at once.

    Returns
    -------
    Factor
    """
    count = len(matrix)
    lost = np.where(undetermined, LOST_ALL, 0.0)
    columns = np.flatnonzero(~undetermined)
    direct = _factorise_regular(matrix if len(columns) == count else matrix[np.ix_(columns, columns)])
    if direct is not None:
        lost[columns] = -2.0 * np.log10(np.diag(direct))
        return Factor(columns, direct, lost, undetermined.copy())

    work = Elimination(matrix.copy(), np.full((count, count), 0.0), [], lost, np.zeros((0, count)))
    deferred = work.eliminate_in_order(columns)
    removed = undetermined.copy()
    removed[work.eliminate_by_size(deferred, max_lost_digits)] = True
    order = np.array(work.order, dtype=np.int64)
    return Factor(order, work.factor[order, : len(order)], lost, removed)


def _factorise_regular(matrix: FloatArray) -> FloatArray | None:
    """Return L where no column loses more than the deferral limit: the usual case, at LAPACK's speed."""
    if not len(matrix):
        return matrix
    # symmetric, so that its transpose is the same, in LAPACK's order
    lower, info = lapack.dpotrf(matrix.T, lower=1, clean=1)
    if info != 0 or np.diag(lower).min() ** 2 < 10.0**-DEFERRAL_DIGITS:
        return None
    return np.asarray(lower)


@dataclass(slots=True)
class Elimination:
    """A right-looking elimination in progress.

    Parameters
    ----------
    matrix : array (m, m)
        What remains.
    factor : array (m, m)
        Rows of L by column number.
    order : list of int
        Columns that are eliminated.
    lost : array (m,)
    spread : array (k, m)
        How k unknowns that were eliminated before move with each column.
    """

    matrix: FloatArray
    factor: FloatArray
    order: list[int]
    lost: FloatArray
    spread: FloatArray

    def eliminate_in_order(self, columns: IntArray) -> list[int]:
        """Eliminate sound columns panel by panel and return the deferred ones."""
        deferred: list[int] = []
        for start in range(0, len(columns), _PANEL):
            panel, rest = columns[start : start + _PANEL], columns[start + _PANEL :]
            outside = np.concatenate([np.array(deferred, dtype=np.int64), rest])
            first = len(self.order)
            left: list[int] = []
            for place, column in enumerate(panel):
                if self._lost_digits(column) > DEFERRAL_DIGITS:
                    left.append(int(column))
                else:
                    # inside the panel the remainder is kept up to date; the outside follows with one matrix product
                    self._eliminate(column, np.concatenate([np.array(left, dtype=np.int64), panel[place + 1 :]]))
            self._catch_up(outside, np.array(left, dtype=np.int64), first)
            deferred += left
        return deferred

    def eliminate_by_size(self, columns: list[int], max_lost_digits: float, later: Sequence[int] = ()) -> list[int]:
        """Eliminate by largest remaining pivot first; return the columns that are not determined.

        `later` are columns that will be eliminated after these.
        """
        remaining = list(columns)
        while remaining:
            best = max(remaining, key=lambda column: float(self.matrix[column, column]))
            if self.digits_of_movement(best) > max_lost_digits:
                for column in remaining:
                    self.lost[column] = self.digits_of_movement(column)
                return remaining
            remaining.remove(best)
            self._eliminate(best, np.array([*remaining, *later], dtype=np.int64))
        return []

    def _lost_digits(self, column: int) -> float:
        pivot = self.matrix[column, column]
        return float(-np.log10(pivot)) if pivot > 0.0 else LOST_ALL

    def digits_of_movement(self, column: int) -> float:
        """Return the digits lost by a column together with the movement of the eliminated ones that goes with it.

        Where the columns before fix a movement of the whole badly, they answer a column that nothing determines with
        large movements x, and leave it a pivot of rounding magnified by |x|². The pivot over 1 + |x|² is that of the
        movement itself, and no larger than the digits of the least determined combination.
        """
        order = np.array(self.order, dtype=np.int64)
        places = len(order)
        lower = self.factor[order, :places]
        x = solve_triangular(lower, self.factor[column, :places], lower=True, trans="T")
        before = self.spread[:, column] - self.spread[:, order] @ x
        return min(self._lost_digits(column) + float(np.log10(1.0 + x @ x + before @ before)), LOST_ALL)

    def _eliminate(self, column: int, targets: IntArray) -> None:
        """Take a column into L and update the remainder of the target columns."""
        self.lost[column] = self._lost_digits(column)
        place = len(self.order)
        root = np.sqrt(self.matrix[column, column])
        self.factor[column, place] = root
        row = self.matrix[column, targets] / root
        self.factor[targets, place] = row
        self.matrix[np.ix_(targets, targets)] -= np.outer(row, row)
        self.order.append(int(column))

    def _catch_up(self, outside: IntArray, left: IntArray, first: int) -> None:
        """Apply the columns eliminated since place `first` to the columns outside their panel.

        `left` are the panel's own deferred columns, which are up to date among themselves.
        """
        eliminated = np.array(self.order[first:], dtype=np.int64)
        if not len(eliminated) or not len(outside):
            return
        places = slice(first, len(self.order))
        triangle = self.factor[eliminated, places]
        rows = solve_triangular(triangle, self.matrix[np.ix_(eliminated, outside)], lower=True).T
        self.factor[outside, places] = rows
        self.matrix[np.ix_(outside, outside)] -= rows @ rows.T
        border = self.factor[left, places] @ rows.T
        self.matrix[np.ix_(left, outside)] -= border
        self.matrix[np.ix_(outside, left)] -= border.T
