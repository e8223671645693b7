"""Cholesky factorisation along a dissection, its selected inverse, and the removal of what is not determined.

A full matrix of the same unknowns names the same ones as not determined (`orip.adjustment.factorisation.null_space`).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import partial

import numpy as np
from msgspec import Struct

from orip.adjustment.factorisation.dissection.matrix import (
    DissectedMatrix,
    Shape,
    dissected_matrix,
    eliminate_front,
    invert_front,
    pivots_of,
    reduce_front,
    substitute_front,
)
from orip.adjustment.factorisation.dissection.tree import DissectionTree, Handles, Passes
from orip.adjustment.factorisation.null_space import factor_of_determined
from orip.arrays import BoolArray, FloatArray


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

    Returns
    -------
    DissectedFactor
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
