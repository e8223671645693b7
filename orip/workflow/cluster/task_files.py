"""Tasks in files of the folder that client and workers share: values need not be in messages, nor with the scheduler.

All tasks of a pass are in one file. It stays for as long as a task of the pass may have to be repeated. Others may be
able to write in that folder, and what is unpickled can run any code: messages have the digest of each task.
"""

from __future__ import annotations

import hashlib
import os
import pickle
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path
from typing import Any, BinaryIO
from weakref import finalize

from msgspec import Struct

from orip.errors import OripError
from orip.files.text.atomic import temporary_beside
from orip.files.text.own_files import make_folder, new_file, remove_file
from orip.workflow.cluster.facts import UnfitWorkerError


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
    tasks : iterable

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
