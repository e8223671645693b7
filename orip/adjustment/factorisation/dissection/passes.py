"""How functions are applied to all nodes of a tree: side by side, from the bottom up, or from the root down.

The mathematics of the nodes know nothing of where they are computed. What they return stays where that was, and is
passed on as a handle; only what is gathered comes back.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Protocol

from orip.adjustment.factorisation.dissection.tree import DissectionTree

Handle = Any
"""A result of a node: the value itself, or what stands for it in another process."""


class Passes(Protocol):
    """What applies functions to the nodes of a tree. Items are sequences with a value or handle for each node."""

    def kept(self, items: Sequence[Any]) -> list[Handle]:
        """Return handles of values that are used more than once."""

    def each(self, function: Callable[..., Any], *items: Sequence[Any]) -> list[Handle]:
        """Apply a function to the items of every node."""

    def upward(
        self, tree: DissectionTree, function: Callable[..., tuple[Any, Any]], *items: Sequence[Any]
    ) -> list[Handle]:
        """Apply a function to the items of every node and, as further arguments, what its children passed up.

        It returns what is kept, and what is passed up.
        """

    def downward(
        self, tree: DissectionTree, function: Callable[..., tuple[Any, Sequence[Any]]], *items: Sequence[Any]
    ) -> list[Handle]:
        """Apply a function to the items of every node and what its parent passed down to it, None for the root.

        It returns what is kept, and what is passed down to each of its children.
        """

    def gathered(self, handles: Sequence[Handle]) -> list[Any]:
        """Return the values of handles."""


class InTurn:
    """All nodes in this process, one after the other."""

    def kept(self, items: Sequence[Any]) -> list[Handle]:
        """Return the values themselves."""
        return list(items)

    def each(self, function: Callable[..., Any], *items: Sequence[Any]) -> list[Handle]:
        """Apply a function to the items of every node."""
        return [function(*of_node) for of_node in zip(*items, strict=True)]

    def upward(
        self, tree: DissectionTree, function: Callable[..., tuple[Any, Any]], *items: Sequence[Any]
    ) -> list[Handle]:
        """Apply a function from the bottom up."""
        kept: list[Handle] = []
        passed: dict[int, Any] = {}
        for number, (node, of_node) in enumerate(zip(tree.nodes, zip(*items, strict=True), strict=True)):
            found, passed[number] = function(*of_node, *(passed.pop(child) for child in node.children))
            kept.append(found)
        return kept

    def downward(
        self, tree: DissectionTree, function: Callable[..., tuple[Any, Sequence[Any]]], *items: Sequence[Any]
    ) -> list[Handle]:
        """Apply a function from the root down."""
        kept: list[Handle] = [None] * len(tree)
        given: dict[int, Any] = {}
        rows = list(zip(*items, strict=True))
        for number in reversed(range(len(tree))):
            kept[number], passed = function(*rows[number], given.pop(number, None))
            given.update(zip(tree.nodes[number].children, passed, strict=True))
        return kept

    def gathered(self, handles: Sequence[Handle]) -> list[Any]:
        """Return the values themselves."""
        return list(handles)
