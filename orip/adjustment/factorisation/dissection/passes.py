"""How functions are applied to all nodes of a tree: side by side, from the bottom up, or from the root down.

The mathematics of the nodes know nothing of where they are computed. What they return stays where that was, and is
passed on as a handle; only what is gathered comes back.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any, Protocol

from msgspec import Struct

from orip.adjustment.factorisation.dissection.tree import DissectionTree

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
