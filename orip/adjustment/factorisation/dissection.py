"""Nested dissection of the reduced unknowns (George 1973): Helmert's blocking, with separators on several levels."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any, Protocol

import numpy as np
from msgspec import Struct, field
from scipy.sparse import csr_array

from orip.arrays import BoolArray, FloatArray, IntArray

# Helmert (1880) reduced the normal equations of each part of a network to the stations at its border, and added what
# remained. Here every part is divided again until it is small, by separators: photos without which no point is seen
# from both sides (George 1973). A node of the tree is a separator or an undivided part. Its *front* are its own
# unknowns and its *border*: the unknowns of nodes above that are coupled with it.

_BORDER_SHARE = 0.25
"""Part of all groups of unknowns; one without a position that is coupled with more of them goes to the root."""

_LEAST_SHARE = 0.2
"""Least part of the groups on either side of a separator, where there is a choice."""


class Node(Struct, frozen=True):
    """A node of the tree.

    Parameters
    ----------
    own : array (o,) of int
        Unknowns that are eliminated here.
    border : array (r,) of int
        Unknowns of nodes above that are coupled with them, in the order of `DissectionTree.place`.
    parent : int
        -1 for the root.
    children : tuple of int
    in_parent : array (r,) of int
        Places of the border in the parent's front.
    """

    own: IntArray
    border: IntArray
    parent: int
    children: tuple[int, ...]
    in_parent: IntArray

    @property
    def front(self) -> IntArray:
        """Return its own unknowns, then its border."""
        return np.concatenate([self.own, self.border])


class DissectionTree(Struct, frozen=True):
    """The tree of m reduced unknowns; children stand before their parents, the root last.

    Parameters
    ----------
    nodes : tuple of Node
    node_of : array (m,) of int
        The node that eliminates each unknown.
    place : array (m,) of int
        Place of each unknown in the order of elimination.
    """

    nodes: tuple[Node, ...]
    node_of: IntArray
    place: IntArray

    def __len__(self) -> int:
        return len(self.nodes)

    def in_front(self, node: int, unknowns: IntArray) -> IntArray:
        """Return places of unknowns in the front of a node.

        Raises
        ------
        IndexError
            If one is not in it.
        """
        front = self.place[self.nodes[node].front]
        wanted = self.place[unknowns]
        found = np.minimum(np.searchsorted(front, wanted), max(len(front) - 1, 0))
        if len(wanted) and not (len(front) and np.array_equal(front[found], wanted)):
            message = "these unknowns have no observation in common: their cofactor is not computed"
            raise IndexError(message)
        return np.asarray(found)

    @property
    def border_bytes(self) -> int:
        """Return the bytes of the equations that all nodes are reduced to: a triangle and a right-hand side each."""
        return sum(8 * (len(node.border) * (len(node.border) + 3) // 2) for node in self.nodes)


def dissected(
    groups: IntArray, touched: csr_array, central: BoolArray, positions: FloatArray, largest: int
) -> DissectionTree:
    """Return the tree of unknowns that come in groups (photos, tied points, cameras).

    Parameters
    ----------
    groups : array (m,) of int
        Group of each unknown, ascending from 0.
    touched : sparse array (r, g)
        Not zero where an observation, or an eliminated point, touches a group.
    central : array (g,) of bool
        Groups that the root eliminates whatever they are coupled with: cofactors between all of them are asked for.
    positions : array (g, d)
        Of groups, roughly; NaN for those without one (cameras).
    largest : int
        Number of groups up to which a part is not divided.
    """
    graph = (touched.T @ touched).tocsr()
    count = graph.shape[0]
    placed = np.asarray(np.isfinite(positions).all(axis=1))
    of_root = central | (~placed & (np.diff(graph.indptr) > _BORDER_SHARE * count))
    found = _Dissection(graph, _filled(positions, placed, graph), largest)
    found.divide(np.flatnonzero(~of_root), np.flatnonzero(of_root))
    return _tree(found.owned, found.parents, groups, touched)


def lowest_nodes(tree: DissectionTree, groups: IntArray, touched: csr_array) -> IntArray:
    """Return for each row of `touched` the node to which it belongs: its groups are all in the front of that node."""
    node_of_group = np.full(touched.shape[1], len(tree) - 1)
    node_of_group[groups] = tree.node_of
    lowest = np.full(touched.shape[0], len(tree) - 1)
    rows = np.repeat(np.arange(touched.shape[0]), np.diff(touched.indptr))
    np.minimum.at(lowest, rows, node_of_group[touched.indices])
    return lowest


def _filled(positions: FloatArray, placed: BoolArray, graph: csr_array) -> FloatArray:
    """Return positions (g, d) with those that are missing in the middle of what they are coupled with."""
    found = np.where(placed[:, None], positions, 0.0)
    missing = np.flatnonzero(~placed)
    for row in missing:
        near = graph.indices[graph.indptr[row] : graph.indptr[row + 1]]
        near = near[placed[near]]
        found[row] = positions[near].mean(axis=0) if len(near) else 0.0
    return found


class _Dissection(Struct):
    """The nodes as they are found; the parents are known when these are."""

    graph: csr_array
    positions: FloatArray
    largest: int
    owned: list[IntArray] = field(default_factory=list)
    parents: list[int] = field(default_factory=list)

    def divide(self, part: IntArray, also_own: IntArray) -> int:
        """Divide a part of the groups, and return the number of its node, which eliminates `also_own` as well."""
        separation = self._separated(part) if len(part) > self.largest else None
        if separation is None:
            return self._node(np.concatenate([part, also_own]), ())
        first, other, separator = separation
        nothing = np.zeros(0, dtype=np.int64)
        children = [self.divide(side, nothing) for side in (first, other)]
        return self._node(np.concatenate([separator, also_own]), children)

    def _node(self, own: IntArray, children: Sequence[int]) -> int:
        number = len(self.owned)
        self.owned.append(own)
        self.parents.append(-1)
        for child in children:
            self.parents[child] = number
        return number

    def _separated(self, part: IntArray) -> tuple[IntArray, IntArray, IntArray] | None:
        """Return two sides and the smallest separator found; None where the part is too dense to be divided."""
        inner = self.graph[part][:, part].tocsr()
        places = self.positions[part]
        _, _, axes = np.linalg.svd(places - places.mean(axis=0), full_matrices=False)
        best: tuple[IntArray, IntArray, IntArray] | None = None
        for along in (places @ axes.T).T:
            order = np.argsort(along, kind="stable")
            is_first = np.zeros(len(part), dtype=bool)
            is_first[order[: len(part) // 2]] = True
            for side in (is_first, ~is_first):
                separator = side & (inner @ (~side).astype(np.float64) > 0.0)
                sides = np.flatnonzero(side & ~separator), np.flatnonzero(~side)
                if min(map(len, sides)) < _LEAST_SHARE * len(part):
                    continue
                if best is None or np.count_nonzero(separator) < len(best[2]):
                    best = *sides, np.flatnonzero(separator)
        return None if best is None else (part[best[0]], part[best[1]], part[best[2]])


def _tree(owned: Sequence[IntArray], parents: Sequence[int], groups: IntArray, touched: csr_array) -> DissectionTree:
    """Return the tree with the unknowns of groups, and the border of each node, from the bottom to the top."""
    count = touched.shape[1]
    node_of_group = np.empty(count, dtype=np.int64)
    for number, own in enumerate(owned):
        node_of_group[own] = number
    node_of = node_of_group[groups]
    order = np.argsort(node_of, kind="stable")
    place = np.empty(len(groups), dtype=np.int64)
    place[order] = np.arange(len(groups))
    children: list[list[int]] = [[] for _ in owned]
    for number, parent in enumerate(parents):
        if parent >= 0:
            children[parent].append(number)
    coupled = _coupled_groups(node_of_group, touched, len(owned))
    borders: list[IntArray] = []
    first = np.searchsorted(groups, np.arange(count + 1))
    own_unknowns = np.split(order, np.cumsum(np.bincount(node_of, minlength=len(owned)))[:-1])
    for number, below in enumerate(children):
        known = np.unique(np.concatenate([coupled[number], *(borders[child] for child in below)]))
        borders.append(known[node_of_group[known] > number])
    nodes = []
    borders_of = [_unknowns_of(border, first, place) for border in borders]
    for number, parent in enumerate(parents):
        border = borders_of[number]
        in_parent = np.zeros(0, dtype=np.int64)
        if parent >= 0:
            front = place[np.concatenate([own_unknowns[parent], borders_of[parent]])]
            in_parent = np.searchsorted(front, place[border])
        nodes.append(Node(own_unknowns[number], border, parent, tuple(children[number]), in_parent))
    return DissectionTree(tuple(nodes), node_of, place)


def _coupled_groups(node_of_group: IntArray, touched: csr_array, nodes: int) -> list[IntArray]:
    """Return for each node the groups that its observations and points touch."""
    rows = np.repeat(np.arange(touched.shape[0]), np.diff(touched.indptr))
    lowest = np.full(touched.shape[0], nodes - 1)
    np.minimum.at(lowest, rows, node_of_group[touched.indices])
    keys = np.unique(lowest[rows] * touched.shape[1] + touched.indices)
    return np.split(keys % touched.shape[1], np.searchsorted(keys // touched.shape[1], np.arange(1, nodes)))


def _unknowns_of(border: IntArray, first: IntArray, place: IntArray) -> IntArray:
    """Return the unknowns of some groups in the order of elimination."""
    found = [np.arange(first[group], first[group + 1]) for group in border]
    unknowns = np.concatenate([np.zeros(0, dtype=np.int64), *found])
    return np.asarray(unknowns[np.argsort(place[unknowns])])


# The mathematics of the nodes know nothing of where they are computed. What they return stays where that was, and is
# passed on as a handle; only what is gathered comes back.

Handles = Any
"""Results of all nodes: the values themselves, or what stands for them in other processes."""


class Passes(Protocol):
    """What applies functions to the nodes of a tree. Items are handles, or sequences with a value for each node."""

    def kept(self, items: Sequence[Any]) -> Handles:
        """Return handles of values that are used more than once."""

    def each(self, function: Callable[..., Any], *items: Any, only: Sequence[int] | None = None) -> Handles:
        """Apply a function to the items of every node, or of some: values are those of these alone then."""

    def upward(self, function: Callable[..., tuple[Any, Any]], *items: Any) -> Handles:
        """Apply a function to the items of every node and, as further arguments, what its children passed up.

        It returns what is kept, and what is passed up.
        """

    def downward(self, function: Callable[..., tuple[Any, Sequence[Any]]], *items: Any) -> Handles:
        """Apply a function to the items of every node and what its parent passed down to it, None for the root.

        It returns what is kept, and what is passed down to each of its children.
        """

    def gathered(self, handles: Handles) -> Iterator[Any]:
        """Yield the values of handles, node after node."""


class InTurn(Struct, frozen=True):
    """All nodes of a tree in this process, one after the other."""

    tree: DissectionTree

    def kept(self, items: Sequence[Any]) -> Handles:
        """Return the values themselves."""
        return items

    def each(self, function: Callable[..., Any], *items: Any, only: Sequence[int] | None = None) -> Handles:
        """Apply a function to the items of every node."""
        numbers = range(len(self.tree)) if only is None else only
        columns = [item if len(item) == len(numbers) else [item[number] for number in numbers] for item in items]
        return [function(*of_node) for of_node in zip(*columns, strict=True)]

    def upward(self, function: Callable[..., tuple[Any, Any]], *items: Any) -> Handles:
        """Apply a function from the bottom up."""
        return upward(topology(self.tree), list(zip(*items, strict=True)), function, {})[0]

    def downward(self, function: Callable[..., tuple[Any, Sequence[Any]]], *items: Any) -> Handles:
        """Apply a function from the root down."""
        return downward(topology(self.tree), list(zip(*items, strict=True)), function, None)[0]

    def gathered(self, handles: Handles) -> Iterator[Any]:
        """Yield the values themselves."""
        return iter(handles)


Topology = Sequence[tuple[int, tuple[int, ...]]]
"""Numbers of nodes, children before parents and a root last, with the numbers of their children."""


def topology(tree: DissectionTree) -> Topology:
    """Return the topology of a whole tree."""
    return [(number, node.children) for number, node in enumerate(tree.nodes)]


def upward(
    nodes: Topology, rows: Sequence[Sequence[Any]], function: Callable[..., tuple[Any, Any]], passed: dict[int, Any]
) -> tuple[list[Any], Any]:
    """Apply a function to nodes from the bottom up; `passed` has what children outside of these passed up.

    Returns
    -------
    list
        What is kept, for each node.
    object
        What the root passed up.
    """
    kept = []
    passed = dict(passed)
    for (number, children), row in zip(nodes, rows, strict=True):
        found, passed[number] = function(*row, *(passed.pop(child) for child in children))
        kept.append(found)
    return kept, passed.pop(nodes[-1][0])


def downward(
    nodes: Topology, rows: Sequence[Sequence[Any]], function: Callable[..., tuple[Any, Sequence[Any]]], given: Any
) -> tuple[list[Any], dict[int, Any]]:
    """Apply a function to nodes from the root down; `given` is what was passed to the root.

    Returns
    -------
    list
        What is kept, for each node.
    dict
        What was passed to children outside of these nodes.
    """
    kept: list[Any] = [None] * len(nodes)
    passed = {nodes[-1][0]: given}
    for place in reversed(range(len(nodes))):
        number, children = nodes[place]
        kept[place], down = function(*rows[place], passed.pop(number))
        passed.update(zip(children, down, strict=True))
    return kept, passed
