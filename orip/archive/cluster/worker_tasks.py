"""What a worker does with a group of nodes, what it returns, and the files in which tasks are handed over."""

from __future__ import annotations

import hashlib
import os
import pickle
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO
from weakref import finalize

import numpy as np
from msgspec import Struct, field
from msgspec.structs import astuple

from orip.adjustment.factorisation.dissection import Topology, downward, upward
from orip.archive.cluster.connection import UnfitWorkerError
from orip.errors import OripError
from orip.files.text.atomic import temporary_beside
from orip.files.text.own_files import make_folder, new_file, remove_file

# All tasks of a pass are in one file. It stays for as long as a task of the pass may have to be repeated. Others may be
# able to write in that folder, and what is unpickled can run any code: messages have the digest of each task.


class StoredTask(Struct, frozen=True):
    """A task in a file, where it begins, how long it is, and the SHA-256 of it."""

    path: str
    start: int
    size: int
    digest: bytes

    def read(self) -> Any:
        """Return the task.

        Raises
        ------
        UnfitWorkerError
            If this process does not see the file, or it is no longer what was written.
        """
        try:
            with open(self.path, "rb", opener=_opened) as file:
                file.seek(self.start)
                task = file.read(self.size)
        except OSError as error:
            message = f"a worker cannot read {self.path}, which needs the same path on all machines ({error})"
            raise UnfitWorkerError(message) from None
        if hashlib.sha256(task).digest() != self.digest:
            message = (
                f"{self.path} has been changed since it was written; see who else writes in that folder, then repeat "
                "the command"
            )
            raise UnfitWorkerError(message)
        return pickle.loads(task)


def _opened(path: str, flags: int) -> int:
    """Open a file that is no link, without waiting for a pipe."""
    return os.open(path, flags | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0))


class _Digested:
    """Writes to a file, and digests what is written."""

    def __init__(self, file: BinaryIO) -> None:
        self._file, self.digest, self.size = file, hashlib.sha256(), 0

    def write(self, data: Any) -> int:
        self.digest.update(data)
        written = self._file.write(data)
        self.size += written
        return written


class TaskFile(Struct, frozen=True, weakref=True, eq=False):
    """A file with the tasks of a pass, removed when nobody has this any more."""

    tasks: tuple[StoredTask, ...]

    @property
    def bytes(self) -> int:
        """Return its size."""
        return sum(task.size for task in self.tasks)


def stored_tasks(folder: Path, tasks: Iterable[Any]) -> TaskFile:
    """Write tasks, one after the other, so that no more than one of them is in memory.

    Parameters
    ----------
    folder : Path
        Made where it is missing.

    Raises
    ------
    OripError
        If the file cannot be written.
    """
    path = temporary_beside(folder / "tasks")
    try:
        make_folder(folder)
        with new_file(path) as file:
            stored = []
            for task in tasks:
                start, digested = file.tell(), _Digested(file)
                pickle.dump(task, digested, protocol=pickle.HIGHEST_PROTOCOL)
                stored.append(StoredTask(str(path), start, digested.size, digested.digest.digest()))
    except OSError as error:
        _remove(path)
        message = f"{path} cannot be written: {error.strerror or error}; make room there, then repeat the command"
        raise OripError(message) from error
    written = TaskFile(tuple(stored))
    finalize(written, _remove, path)
    return written


def _remove(path: Path) -> None:
    with suppress(OSError):  # those of killed runs are removed by the next one
        remove_file(path)


class Argument(Struct, frozen=True):
    """The values that are an argument of a task, by its number."""

    number: int


class GroupTask(Struct, frozen=True):
    """What a worker does with a group of nodes.

    Parameters
    ----------
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
