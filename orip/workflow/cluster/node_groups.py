"""Groups of nodes that are computed together, and the memory that a worker needs for them."""

from __future__ import annotations

from orip.adjustment.factorisation.dissection.tree import DissectionTree, Node

_PROCESS_BYTES, _COPIES = 250_000_000, 6
"""What a worker needs: for its programs and photo points, and squares of the largest front while that is computed."""


def grouped(tree: DissectionTree, most: int) -> tuple[tuple[int, ...], ...]:
    """Return the largest subtrees whose fronts have so many bytes at most, and each node above them by itself.

    The fronts above are the largest of all, and no worker has room for all of them.
    """
    sizes, count = [front_bytes(node) for node in tree.nodes], [1] * len(tree)
    for number, node in enumerate(tree.nodes):
        sizes[number] += sum(sizes[child] for child in node.children)
        count[number] += sum(count[child] for child in node.children)
    return tuple(
        tuple(range(number - count[number] + 1, number + 1)) if sizes[number] <= most else (number,)
        for number, node in enumerate(tree.nodes)
        if sizes[number] > most or node.parent < 0 or sizes[node.parent] > most
    )


def front_bytes(node: Node) -> int:
    """Return the bytes of the triangle of a node's front."""
    size = len(node.own) + len(node.border)
    return 4 * size * (size + 1)


def least_memory(tree: DissectionTree) -> int:
    """Return the bytes without which a worker cannot compute the largest front of a tree."""
    return _PROCESS_BYTES + _COPIES * 2 * max(map(front_bytes, tree.nodes))
