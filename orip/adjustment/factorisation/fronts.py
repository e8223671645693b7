"""A symmetric matrix by the fronts of a dissection, which are formed, factored and reduced to their border."""

from __future__ import annotations

from collections import OrderedDict
from math import isqrt
from typing import NamedTuple

import numpy as np
from msgspec import Struct, field
from scipy.linalg import blas, lapack

from orip.adjustment.factorisation.dissection import DissectionTree, Handles, Passes
from orip.adjustment.factorisation.lapack import solve_lower
from orip.arrays import BoolArray, FloatArray, IntArray

# With the own unknowns first a front is (A, B^T; B, C). Its factor has L with L L^T = A and E = B L^-T, and what
# remains for the nodes above is C - E E^T.
#
# Symmetric matrices (n, n) are kept and passed on as their lower triangles, row by row: arrays (n (n + 1) / 2,).


class Shape(NamedTuple):
    """A node as its front needs it: the number of its own unknowns, and places of its children's borders in it."""

    own: int
    children: tuple[IntArray, ...]


class FrontScale(NamedTuple):
    """What is done to the equations of a node before they are factored.

    Attributes
    ----------
    factors : array (f,)
        Of rows and columns of the front; 0 for unknowns that are removed.
    added : array (o,)
        To the diagonal of its own unknowns.
    """

    factors: FloatArray
    added: FloatArray


class FrontFactor(NamedTuple):
    """Factor of a front: L (o, o) and E (r, o)."""

    lower: FloatArray
    below: FloatArray


def triangle_of(matrix: FloatArray) -> FloatArray:
    """Return the lower triangle (n (n + 1) / 2,) of a matrix (n, n), row by row."""
    # LAPACK counts by columns: its upper triangle of the transpose
    return np.asarray(lapack.dtrttp(matrix.T, uplo="U")[0])


def lower_of(triangle: FloatArray) -> FloatArray:
    """Return a matrix (n, n) with a lower triangle, and zeros above."""
    size = (isqrt(8 * len(triangle) + 1) - 1) // 2
    return np.asarray(lapack.dtpttr(size, triangle, uplo="U")[0].T) if size else np.zeros((0, 0))


def symmetric_of(triangle: FloatArray) -> FloatArray:
    """Return the symmetric matrix (n, n) of a triangle."""
    found = lower_of(triangle)
    return found + np.tril(found, -1).T


def eliminate_front(
    matrix: FloatArray, shape: Shape, scale: FrontScale, *of_children: FloatArray | None
) -> tuple[FrontFactor | None, FloatArray | None]:
    """Return the factor of a front and, as a triangle, what remains for the border; None where it has no factor.

    Parameters
    ----------
    matrix : array (f (f + 1) / 2,)
        What the node's own observations add to the normal equations.
    of_children : arrays or None
        Triangles of what remained of the children's fronts.
    """
    remainders = [remainder for remainder in of_children if remainder is not None]
    if len(remainders) < len(of_children):
        return None, None
    front = lower_of(matrix)
    front *= scale.factors
    front *= scale.factors[:, None]
    # what is not finite has no part in anything either
    removed = scale.factors == 0.0
    front[removed], front[:, removed] = 0.0, 0.0
    for places, remainder in zip(shape.children, remainders, strict=True):
        # places ascend, so that a lower triangle stays one
        front[np.ix_(places, places)] += lower_of(remainder)
    own = shape.own
    front[np.arange(own), np.arange(own)] += scale.added
    if not own:
        return FrontFactor(np.zeros((0, 0)), np.zeros((len(front), 0))), triangle_of(front)
    if not np.isfinite(front).all():
        return None, None
    lower, info = lapack.dpotrf(front[:own, :own], lower=1, clean=1)
    if info != 0:
        return None, None
    below = solve_lower(lower, front[own:, :own].T).T
    rest = below @ below.T
    np.subtract(front[own:, own:], rest, out=rest)
    return FrontFactor(np.asarray(lower), np.asarray(below)), triangle_of(rest)


def pivots_of(factor: FrontFactor | None) -> FloatArray | None:
    """Return the diagonal (o,) of L; None where there is no factor."""
    return None if factor is None else np.diag(factor.lower).copy()


def reduce_front(
    factor: FrontFactor, shape: Shape, right: FloatArray, *of_children: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return c = L^-1 b (o, k) of right-hand sides (o, k), and what they add to those of the border (r, k)."""
    own = shape.own
    front = np.zeros((own + len(factor.below), right.shape[1]))
    front[:own] = right
    for places, added in zip(shape.children, of_children, strict=True):
        front[places] += added
    reduced = solve_lower(factor.lower, front[:own]) if own else front[:0]
    return np.asarray(reduced), np.asarray(front[own:] - factor.below @ reduced)


def substitute_front(
    factor: FrontFactor, shape: Shape, reduced: FloatArray, of_border: FloatArray | None
) -> tuple[FloatArray, list[FloatArray]]:
    """Return the own unknowns (o, k) from c (o, k) and those of the border (r, k), and the children's borders."""
    border = np.zeros((0, reduced.shape[1])) if of_border is None else of_border
    rest = reduced - factor.below.T @ border
    own = solve_lower(factor.lower, rest, transposed=True) if shape.own else rest
    front = np.vstack([own, border])
    return np.asarray(own), [front[places] for places in shape.children]


def invert_front(
    factor: FrontFactor, shape: Shape, of_border: FloatArray | None
) -> tuple[FloatArray, list[FloatArray]]:
    """Return the inverse of the whole matrix in the places of a front, and those of its children's borders.

    All are triangles. With G = -E L^-1 and the inverse Z of the border it is (L^-T L^-1 + G^T Z G, G^T Z; Z G, Z):
    Takahashi's recursion (1973) by fronts.
    """
    own = shape.own
    border = np.zeros((0, 0)) if of_border is None else lower_of(of_border)
    inverse = solve_lower(factor.lower, np.eye(own)) if own else np.zeros((0, 0))
    multiplier = -factor.below @ inverse
    below = _symmetric_times(border, multiplier)
    found = np.zeros((own + len(border),) * 2)
    found[:own, :own] = inverse.T @ inverse + multiplier.T @ below
    found[own:, :own], found[own:, own:] = below, border
    return triangle_of(found), [triangle_of(found[np.ix_(places, places)]) for places in shape.children]


def front_times(matrix: FloatArray, vectors: FloatArray) -> FloatArray:
    """Return the equations of a node, a triangle, times vectors (f, k)."""
    return _symmetric_times(lower_of(matrix), vectors)


def _symmetric_times(lower: FloatArray, vectors: FloatArray) -> FloatArray:
    """Return the symmetric matrix of a lower triangle (n, n) times vectors (n, k)."""
    if not vectors.size:
        return np.zeros(vectors.shape)
    return np.asarray(blas.dsymm(1.0, lower.T, vectors, lower=0))


def is_finite(matrix: FloatArray) -> bool:
    """Return whether all elements are numbers."""
    return bool(np.isfinite(matrix).all())


def elements(matrix: FloatArray, rows: IntArray, columns: IntArray) -> FloatArray:
    """Return some elements of a front that is given as a triangle; rows and columns are broadcast."""
    later, earlier = np.maximum(rows, columns), np.minimum(rows, columns)
    return np.asarray(matrix[later * (later + 1) // 2 + earlier])


def own_rows(matrix: FloatArray, own: int) -> FloatArray:
    """Return the rows (o, f) of the own unknowns of a triangle."""
    return elements(matrix, np.arange(own)[:, None], np.arange((isqrt(8 * len(matrix) + 1) - 1) // 2))


def adjusted_front(triangle: FloatArray, factors: FloatArray, left: FloatArray, right: FloatArray) -> FloatArray:
    """Return a front (f, f) with rows and columns multiplied by factors (f,), less L R^T of matrices (f, k)."""
    found = symmetric_of(triangle)
    found *= factors
    found *= factors[:, None]
    found -= left @ right.T
    return found


_KEPT_NODES = 64
"""Nodes whose own rows are kept once they were asked for: elements are asked for photo by photo."""

_FEW = 2
"""Nodes from which a request takes elements by their own rows."""


class DissectedMatrix(Struct):
    """A matrix (m, m) of which every node has the part in its front, wherever that is.

    Of normal equations a part is what the node's own observations add, and the matrix is the sum of all parts. Of an
    inverse it is the elements themselves. Multiplication of rows and columns, additions to the diagonal, and products
    that are subtracted are remembered, and done where the parts are.

    Parameters
    ----------
    tree : DissectionTree
    passes : Passes
    parts : handles of arrays (f (f + 1) / 2,)
        Triangles, row by row.
    factors : array (m,)
        By which rows and columns are multiplied.
    added : array (m,)
        To the diagonal, after that.
    left, right : arrays (m, k)
        Whose product L R^T is subtracted.
    """

    tree: DissectionTree
    passes: Passes
    parts: Handles
    factors: FloatArray
    added: FloatArray
    left: FloatArray
    right: FloatArray
    _rows: OrderedDict[int, FloatArray] = field(default_factory=OrderedDict)

    def __len__(self) -> int:
        return len(self.factors)

    def __getitem__(self, key: tuple[IntArray | int, ...]) -> FloatArray:
        """Return elements of an inverse by rows and columns, which are broadcast.

        Raises
        ------
        IndexError
            For an element that is in no front.
        """
        rows, columns = np.broadcast_arrays(np.asarray(key[0]), np.asarray(key[1]))
        i, j = rows.ravel(), columns.ravel()
        found = self._elements(i, j) * self.factors[i] * self.factors[j]
        found -= np.einsum("ij,ij->i", self.left[i], self.right[j])
        return np.asarray(found.reshape(rows.shape)[()])

    def diagonal(self) -> FloatArray:
        """Return the diagonal (m,) of an inverse."""
        every = np.arange(len(self))
        return self[every, every]

    def scale(self, factors: FloatArray) -> None:
        """Multiply rows and columns by factors (m,)."""
        self.factors = self.factors * factors
        self.added = self.added * factors**2
        self.left, self.right = self.left * factors[:, None], self.right * factors[:, None]

    def add_to_diagonal(self, number: float) -> None:
        """Add a number to all elements of the diagonal."""
        self.added = self.added + number

    def subtract_product(self, left: FloatArray, right: FloatArray) -> None:
        """Subtract L R^T, a symmetric matrix of factors (m, k)."""
        self.left, self.right = np.hstack([self.left, left]), np.hstack([self.right, right])

    def copy(self) -> DissectedMatrix:
        """Return the same matrix, to be changed."""
        return DissectedMatrix(
            self.tree, self.passes, self.parts, self.factors, self.added, self.left, self.right, self._rows
        )

    def times(self, vectors: FloatArray) -> FloatArray:
        """Return normal equations times vectors (m, k)."""
        nodes = self.tree.nodes
        scaled = self.factors[:, None] * vectors
        products = self.passes.gathered(
            self.passes.each(front_times, self.parts, [scaled[node.front] for node in nodes])
        )
        found = np.zeros_like(vectors)
        for node, product in zip(nodes, products, strict=True):
            found[node.front] += product
        return np.asarray(self.factors[:, None] * found + self.added[:, None] * vectors)

    def is_finite(self) -> bool:
        """Return whether all elements are numbers."""
        return all(self.passes.gathered(self.passes.each(is_finite, self.parts)))

    def front_scales(self, kept: BoolArray, shift: float) -> list[FrontScale]:
        """Return what is done to the equations of each node: unit rows for unknowns that are not `kept` (m,)."""
        factors = np.where(kept, self.factors, 0.0)
        added = np.where(kept, self.added + shift, 1.0)
        return [FrontScale(factors[node.front], added[node.own]) for node in self.tree.nodes]

    def shapes(self) -> list[Shape]:
        """Return the shapes of the nodes."""
        nodes = self.tree.nodes
        return [Shape(len(node.own), tuple(nodes[child].in_parent for child in node.children)) for node in nodes]

    def of_fronts(self, vectors: FloatArray) -> list[FloatArray]:
        """Return the rows of vectors (m, ...) in the front of each node."""
        return [vectors[node.front] for node in self.tree.nodes]

    def _elements(self, i: IntArray, j: IntArray) -> FloatArray:
        found = np.empty(len(i))
        lowest = np.minimum(self.tree.node_of[i], self.tree.node_of[j])
        order = np.argsort(lowest, kind="stable")
        numbers, begins = np.unique(lowest[order], return_index=True)
        wanted = dict(zip(numbers.tolist(), np.split(order, begins[1:]), strict=True))
        places = {
            number: (self.tree.in_front(number, i[rows]), self.tree.in_front(number, j[rows]))
            for number, rows in wanted.items()
        }
        missing = [number for number in wanted if number not in self._rows]
        if len(missing) <= _FEW:
            for number, rows in wanted.items():
                own = self._own_rows(number)
                one, other = places[number]
                found[rows] = own[np.minimum(one, other), np.maximum(one, other)]
            return found
        one, other = zip(*places.values(), strict=True)
        handles = self.passes.each(elements, self.parts, one, other, only=tuple(wanted))
        for rows, values in zip(wanted.values(), self.passes.gathered(handles), strict=True):
            found[rows] = values
        return found

    def _own_rows(self, number: int) -> FloatArray:
        """Return the rows (o, f) of a node's own unknowns; of every element the place that comes first is one."""
        if number not in self._rows:
            handles = self.passes.each(own_rows, self.parts, [len(self.tree.nodes[number].own)], only=(number,))
            (self._rows[number],) = self.passes.gathered(handles)
            if len(self._rows) > _KEPT_NODES:
                self._rows.popitem(last=False)
        self._rows.move_to_end(number)
        return self._rows[number]


def dissected_matrix(tree: DissectionTree, passes: Passes, parts: Handles) -> DissectedMatrix:
    """Return a matrix as its parts are."""
    size = len(tree.place)
    nothing = np.zeros((size, 0))
    return DissectedMatrix(tree, passes, parts, np.ones(size), np.zeros(size), nothing, nothing)
