"""A symmetric matrix of reduced unknowns by the fronts of a dissection."""

from __future__ import annotations

from collections import OrderedDict

import numpy as np
from msgspec import Struct, field

from orip.adjustment.factorisation.dissection.fronts import (
    FrontScale,
    Shape,
    elements,
    front_times,
    is_finite,
    own_rows,
)
from orip.adjustment.factorisation.dissection.passes import Handles, Passes
from orip.adjustment.factorisation.dissection.tree import DissectionTree
from orip.arrays import BoolArray, FloatArray, IntArray

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
