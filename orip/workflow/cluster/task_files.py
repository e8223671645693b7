"""Tasks in files of the folder that client and workers share: values need not be in messages, nor with the scheduler.

All tasks of a pass are in one file. It stays for as long as a task of the pass may have to be repeated.
"""

from __future__ import annotations

import pickle
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path
from typing import Any
from weakref import finalize

from msgspec import Struct

from orip.errors import OripError
from orip.files.text.leftovers import temporary_beside
from orip.files.text.own_files import make_folder, new_file, remove_file
from orip.workflow.cluster.facts import UnfitWorkerError


class StoredTask(Struct, frozen=True):
    """A task in a file, where it begins and how long it is."""

    path: str
    start: int
    size: int

    def read(self) -> Any:
        """Return the task.

        Raises
        ------
        UnfitWorkerError
            If this process does not see the file.
        """
        try:
            with Path(self.path).open("rb") as file:
                file.seek(self.start)
                return pickle.loads(file.read(self.size))
        except OSError as error:
            message = f"a worker cannot read {self.path}, which needs the same path on all machines ({error})"
            raise UnfitWorkerError(message) from None


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
                start = file.tell()
                pickle.dump(task, file, protocol=pickle.HIGHEST_PROTOCOL)
                stored.append(StoredTask(str(path), start, file.tell() - start))
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
