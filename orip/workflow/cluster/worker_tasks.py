"""What a worker does with a group of nodes, and what it returns."""

from __future__ import annotations

import pickle
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from msgspec import Struct, field
from msgspec.structs import astuple

from orip.adjustment.factorisation.dissection.tree import Topology, downward, upward
from orip.workflow.cluster.task_files import StoredTask


class Argument(Struct, frozen=True):
    """The values that are an argument of a task, by its number."""

    number: int


class GroupTask(Struct, frozen=True):
    """What a worker does with a group of nodes.

    Parameters
    ----------
    function : callable
    nodes : Topology
    items : sequence of lists or Argument
        Values for each node, or the argument that has them.
    chosen : sequence of int or None
        Places of the nodes, among those of the group, that are computed; values are those of these.
    passed : mapping of int to int
        Of children outside of the group, the number of the argument with what they passed up.
    given : int or None
        Number of the argument that was passed down to the group.
    """

    function: Callable[..., Any]
    nodes: Topology
    items: Sequence[Any]
    chosen: Sequence[int] | None = None
    passed: dict[int, int] = field(default_factory=dict)
    given: int | None = None

    def rows(self, arguments: Sequence[Any]) -> list[tuple[Any, ...]]:
        """Return the items of each node."""
        columns = []
        for item in self.items:
            values = item
            if isinstance(item, Argument):
                values = arguments[item.number]
                if self.chosen is not None:
                    values = [values[place] for place in self.chosen]
            columns.append(values)
        return list(zip(*columns, strict=True))


@dataclass(frozen=True, slots=True)
class Values(Sequence[Any]):
    """Values of several nodes.

    They move between workers as one piece, for Dask's buffers are not aligned as the compiled loops need, and have
    their true size, by which Dask decides what to write to the disk.
    """

    items: Sequence[Any]

    def __getitem__(self, place: Any) -> Any:
        return self.items[place]

    def __len__(self) -> int:
        return len(self.items)

    def __sizeof__(self) -> int:
        return object.__sizeof__(self) + array_bytes(self.items)

    def __reduce__(self) -> tuple[Callable[[bytes], Values], tuple[bytes]]:
        return as_sent, (pickle.dumps(self.items),)


def as_sent(values: bytes) -> Values:
    """Return values that were sent."""
    return Values(pickle.loads(values))


def read_values(task: StoredTask) -> Values:
    """Return values that were sent to be kept."""
    return Values(task.read())


def run_each(task: StoredTask, *arguments: Values) -> Values:
    """Apply a function to nodes of a group."""
    found: GroupTask = task.read()
    return Values([found.function(*row) for row in found.rows(arguments)])


def run_upward(task: StoredTask, *arguments: Values) -> Values:
    """Apply a function to a group from the bottom up, and return what is kept and what is passed up."""
    found: GroupTask = task.read()
    given = {child: arguments[number][0] for child, number in found.passed.items()}
    kept, passed = upward(found.nodes, found.rows(arguments), found.function, given)
    return Values([Values(kept), Values([passed])])


def run_downward(task: StoredTask, *arguments: Values) -> Values:
    """Apply a function to a group from its root down, and return what is kept and, by children, what is passed down."""
    found: GroupTask = task.read()
    given = None if found.given is None else arguments[found.given][0]
    kept, passed = downward(found.nodes, found.rows(arguments), found.function, given)
    return Values([Values(kept), *(Values([passed[child]]) for child in sorted(passed))])


def part_of(found: Values, which: int) -> Any:
    """Return one of several results of a task."""
    return found[which]


def array_bytes(found: Any) -> int:
    """Return the bytes of all arrays in sequences and records."""
    if isinstance(found, np.ndarray):
        return found.nbytes
    if isinstance(found, list | tuple | Values):
        return sum(map(array_bytes, found))
    return sum(map(array_bytes, astuple(found))) if isinstance(found, Struct) else 0
