"""Cholesky factorisations that remove undetermined unknowns, of full and banded matrices and along a dissection."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import partial

import numpy as np
from msgspec import Struct
from scipy.linalg import blas, lapack

from orip.adjustment.factorisation.band import BandMatrix
from orip.adjustment.factorisation.dissection import DissectionTree, Handles, Passes
from orip.adjustment.factorisation.fronts import (
    DissectedMatrix,
    Shape,
    dissected_matrix,
    eliminate_front,
    invert_front,
    pivots_of,
    reduce_front,
    substitute_front,
)
from orip.adjustment.factorisation.lapack import solve_lower
from orip.adjustment.factorisation.null_space import factor_of_determined
from orip.arrays import BoolArray, FloatArray, IntArray
from orip.structs import replace

# A full matrix of the same unknowns names the same ones as not determined (`orip.adjustment.factorisation.null_space`).


class DissectedFactor(Struct, frozen=True):
    """The factor of the columns that are determined.

    Parameters
    ----------
    tree : DissectionTree
    passes : Passes
    shapes : sequence of Shape
    parts : handles of FrontFactor
    lost_digits : array (m,)
    removed : array (m,) of bool
        Columns that are not determined.
    """

    tree: DissectionTree
    passes: Passes
    shapes: Sequence[Shape]
    parts: Handles
    lost_digits: FloatArray
    removed: BoolArray

    def reduce(self, right: FloatArray) -> FloatArray:
        """Return c = L^-1 right for right-hand sides (m,) or (m, k); rows are those of the columns they belong to."""
        kept = np.where(self.removed, 0.0, 1.0)
        vectors = kept[:, None] * (right[:, None] if right.ndim == 1 else right)
        found = self.passes.upward(
            reduce_front, self.parts, self.shapes, [vectors[node.own] for node in self.tree.nodes]
        )
        return self._put_together(self.passes.gathered(found), right)

    def back_substitute(self, reduced_right: FloatArray) -> FloatArray:
        """Return the solution (m,) or (m, k) of L^T x = c, zero for removed columns."""
        vectors = reduced_right[:, None] if reduced_right.ndim == 1 else reduced_right
        found = self.passes.downward(
            substitute_front, self.parts, self.shapes, [vectors[node.own] for node in self.tree.nodes]
        )
        solution = self._put_together(self.passes.gathered(found), reduced_right)
        solution[self.removed] = 0.0
        return solution

    def inverse(self) -> DissectedMatrix:
        """Return the inverse in the places of all fronts, zero for removed columns."""
        parts = self.passes.downward(invert_front, self.parts, self.shapes)
        found = dissected_matrix(self.tree, self.passes, parts)
        if self.removed.any():
            found.scale((~self.removed).astype(np.float64))
        return found

    def _put_together(self, of_nodes: Iterable[FloatArray], like: FloatArray) -> FloatArray:
        found = np.zeros_like(like)
        for node, values in zip(self.tree.nodes, of_nodes, strict=True):
            found[node.own] = values.reshape(-1, *like.shape[1:])
        return found


def factorise_dissected(
    matrix: DissectedMatrix, max_lost_digits: float, undetermined: BoolArray, first: int = 0
) -> DissectedFactor:
    """Factorise symmetric positive semidefinite normal equations along their tree, removing what is not determined.

    Parameters
    ----------
    matrix : DissectedMatrix
        Scaled so that the diagonal was 1 before any elimination.
    max_lost_digits : float
        A movement whose stiffness has lost more is not determined; a column is removed for it.
    undetermined : array (m,) of bool
        Columns known to have no observation at all; they are removed at once.
    first : int
        Number of leading columns of which one is removed wherever it will do.
    """
    return factor_of_determined(
        partial(_factor, matrix), matrix.times, matrix.is_finite, undetermined, max_lost_digits, first
    )


def _factor(matrix: DissectedMatrix, removed: BoolArray, lost: FloatArray, shift: float) -> DissectedFactor | None:
    """Return the factor of the columns that are not removed, its diagonal enlarged; None if it has none."""
    tree, passes, shapes = matrix.tree, matrix.passes, matrix.shapes()
    parts = passes.upward(eliminate_front, matrix.parts, shapes, matrix.front_scales(~removed, shift))
    pivots = np.ones(len(matrix))
    for node, found in zip(tree.nodes, passes.gathered(passes.each(pivots_of, parts)), strict=True):
        if found is None:
            return None
        pivots[node.own] = found
    digits = np.where(removed, lost, -2.0 * np.log10(pivots))
    return DissectedFactor(tree, passes, shapes, parts, digits, removed.copy())


Symmetric = FloatArray | BandMatrix | DissectedMatrix
"""A symmetric matrix (m, m); all kinds have a diagonal() and elements [rows, columns]."""


def scale_matrix(matrix: Symmetric, factors: FloatArray) -> None:
    """Multiply rows and columns of a matrix by factors (m,)."""
    if isinstance(matrix, np.ndarray):
        matrix *= factors
        matrix *= factors[:, None]
    else:
        matrix.scale(factors)


def subtract_product(matrix: Symmetric, left: FloatArray, right: FloatArray) -> None:
    """Subtract L R^T, a symmetric matrix of factors (m, k), from a matrix where it has elements."""
    if isinstance(matrix, np.ndarray):
        matrix -= left @ right.T
    else:
        matrix.subtract_product(left, right)


def add_to_diagonal(matrix: Symmetric, number: float) -> None:
    """Add a number to all elements of the diagonal of a matrix."""
    if isinstance(matrix, np.ndarray):
        matrix[np.arange(len(matrix)), np.arange(len(matrix))] += number
    else:
        matrix.add_to_diagonal(number)


# The digits that a diagonal element loses during the elimination are watched, as Poder did; which unknowns are removed
# is decided by movements of small stiffness (`orip.adjustment.factorisation.null_space`), not by single pivots:
# rounding leaves a pivot of its own size, magnified, where nothing should be left. A removed unknown has neither row
# nor column, and its correction is zero.

_BLOCK = 128
"""Rows and columns copied at once: a square of 128 kB."""


class Factor(Struct, frozen=True):
    """The factor of the columns that are determined.

    Parameters
    ----------
    lower : array (m, m)
        L with L L^T = N; of a removed column it is that of the unit matrix. What stands above the diagonal is no part
        of it.
    lost_digits : array (m,)
        -log10 of each scaled pivot; of a removed column see `unknowns_to_remove`, `LOST_ALL` without observations.
    removed : array (m,) of bool
        Columns that are not determined.
    """

    lower: FloatArray
    lost_digits: FloatArray
    removed: BoolArray

    def reduce(self, right: FloatArray) -> FloatArray:
        """Return c = L^-1 right for right-hand sides (m,) or (m, k).

        The square sum of c is the drop of the weighted square sum.
        """
        return solve_lower(self.lower, self._determined(right))

    def back_substitute(self, reduced_right: FloatArray) -> FloatArray:
        """Return the solution (m,) or (m, k) of L^T x = c, zero for removed columns."""
        return self._determined(solve_lower(self.lower, reduced_right, transposed=True))

    def inverse(self) -> FloatArray:
        """Return the inverse (m, m), with zero rows and columns for removed columns."""
        if not len(self.lower):
            return np.zeros((0, 0))
        lower, _ = lapack.dpotri(self.lower, lower=1)
        columns = np.flatnonzero(self.removed)
        lower[columns, columns] = 0.0
        _copy_lower_triangle(lower)
        return np.asarray(lower.T)  # LAPACK has columns where NumPy has rows

    def _determined(self, vectors: FloatArray) -> FloatArray:
        """Return vectors (m,) or (m, k) with zero for removed columns."""
        if not self.removed.any():
            return vectors
        return np.where(self.removed.reshape(-1, *[1] * (vectors.ndim - 1)), 0.0, vectors)


def _copy_lower_triangle(matrix: FloatArray) -> None:
    """Copy the lower triangle to the upper one, block by block: both pass through the cache once."""
    for start in range(0, len(matrix), _BLOCK):
        end = start + _BLOCK
        matrix[start:end, end:] = matrix[end:, start:end].T
        square = matrix[start:end, start:end]
        square[:] = np.tril(square) + np.tril(square, -1).T


def factorise(matrix: FloatArray, max_lost_digits: float, undetermined: BoolArray, first: int = 0) -> Factor:
    """Factorise a symmetric positive semidefinite matrix, removing the columns that are not determined.

    Parameters
    ----------
    matrix : array (m, m)
        Scaled so that the diagonal was 1 before any elimination. The factor takes its place.
    max_lost_digits : float
        A movement whose stiffness has lost more is not determined; a column is removed for it.
    undetermined : array (m,) of bool
        Columns known to have no observation at all; they are removed at once.
    first : int
        Number of leading columns of which one is removed wherever it will do.
    """
    given = _Symmetric(matrix)
    return factor_of_determined(given.factor, given.times, given.is_finite, undetermined, max_lost_digits, first)


class _Symmetric:
    """A symmetric matrix and its factor in one array.

    The matrix keeps the triangle above the diagonal, its diagonal has a place of its own, and the factor is below.
    """

    def __init__(self, matrix: FloatArray) -> None:
        """Take a matrix (m, m), both of whose triangles are there."""
        # its transpose is the same, in LAPACK's order
        self._array = np.require(matrix, requirements=["C", "W"]).T
        self._diagonal = np.diag(matrix).copy()
        self._is_intact = True

    def factor(self, removed: BoolArray, lost: FloatArray, shift: float) -> Factor | None:
        """Return the factor of the columns that are not removed, its diagonal enlarged; None if it has none."""
        array = self._array
        if not self._is_intact:
            _copy_lower_triangle(array.T)
        self._is_intact = False
        np.fill_diagonal(array, np.where(removed, 1.0, self._diagonal + shift))
        for column in np.flatnonzero(removed):
            array[column, :column] = array[column + 1 :, column] = 0.0
        if len(array):
            array, info = lapack.dpotrf(array, lower=1, clean=0, overwrite_a=1)
            # not every LAPACK stops at a pivot that is not a number
            if info != 0 or not np.isfinite(np.diag(array)).all():
                return None
        digits = np.where(removed, lost, -2.0 * np.log10(np.diag(array)))
        return Factor(array, digits, removed.copy())

    def times(self, vectors: FloatArray) -> FloatArray:
        """Return the matrix times vectors (m, k)."""
        own = (self._diagonal - np.diag(self._array))[:, None]
        return np.asarray(blas.dsymm(1.0, self._array, vectors)) + own * vectors

    def is_finite(self) -> bool:
        """Return whether all elements are finite."""
        columns = (self._array[:column, column] for column in range(len(self._array)))
        return bool(np.isfinite(self._diagonal).all()) and all(np.isfinite(column).all() for column in columns)


# In the normal equations a constraint c x = 0 has a moderate weight, and its value is met by iterating. Cofactors of
# the unknowns with constraints C (k, m) that have an infinite weight follow from any finite one: Q - S (C S)^-1 S^T
# with S = Q C^T, as the weight drops out of the projection onto the null space of C (Koch 1999, section 3.2.7).

_DEPENDENT = 1e-10
"""Constraints whose cofactors have eigenvalues below this part of the largest repeat each other."""


class ExactConstraints(Struct, frozen=True):
    """k constraints of m + 3 b unknowns, of which those of eliminated blocks take no part.

    Parameters
    ----------
    spread : array (m + 3 b, k)
        S = Q C^T, with Q from normal equations in which the constraints have any weight.
    inverse : array (k, k)
        Pseudo-inverse of C S.
    leverage : array (k,)
        Unknowns that each constraint determines: 1, less where constraints repeat each other.
    """

    spread: FloatArray
    inverse: FloatArray
    leverage: FloatArray

    def bound(self, vectors: FloatArray, right: FloatArray) -> FloatArray:
        """Return Q_c r (m + 3 b, k), with the constraints met, from the vectors Q r and the right-hand sides r."""
        return np.asarray(vectors - self.spread @ (self.inverse @ (self.spread.T @ right)))

    def at(self, columns: IntArray) -> ExactConstraints:
        """Return the constraints for vectors and right-hand sides that have only some of the unknowns (c,)."""
        return replace(self, spread=self.spread[columns])

    def bind(self, cofactor: Symmetric) -> None:
        """Subtract what the constraints determine from the cofactors of the reduced unknowns (m, m), in place."""
        spread = self.spread[: len(cofactor)]
        subtract_product(cofactor, spread @ self.inverse, spread)


def exact_constraints(design: FloatArray, spread: FloatArray) -> ExactConstraints:
    """Return constraints from their rows C (k, m + 3 b) of the design matrix and S (m + 3 b, k)."""
    cofactor = design @ spread
    symmetric = (cofactor + cofactor.T) / 2.0
    inverse = np.asarray(np.linalg.pinv(symmetric, rcond=_DEPENDENT, hermitian=True), dtype=np.float64)
    return ExactConstraints(spread, inverse, np.einsum("ij,ji->i", inverse, cofactor))
