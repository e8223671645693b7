"""Long columns that are set aside: in files from which the system reads what is asked for, and not in memory.

A column has a number or a few for every photo point, and a block may have more photo points than there is memory for.
What is set aside within `columns_in_files` is written to a file without a name, which goes with the array, and mapped:
it takes memory while it is looked at. Elsewhere arrays stay as they are.
"""

from __future__ import annotations

import mmap
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from pathlib import Path
from threading import Event, Lock, Thread
from typing import Any, Generic, TypeVar
from weakref import WeakSet

import numpy as np
from numpy.typing import NDArray

from orip.errors import OripError
from orip.threads import give_back_freed_memory

ScalarT = TypeVar("ScalarT", bound=np.generic)

_LEAST_BYTES = 1 << 18
"""A shorter array stays in memory: a file takes longer, and there are many more short ones."""

_LOOKED_AT_SECONDS = 0.02
"""Pages that were read stay in memory for at most this long."""

_folder: ContextVar[Path | None] = ContextVar("folder", default=None)
_mappings: WeakSet[mmap.mmap] = WeakSet()
_alone = Lock()


@contextmanager
def columns_in_files(folder: Path) -> Iterator[None]:
    """Keep in files of a folder what is set aside within the block.

    Memory that is freed goes back to the system at once.
    """
    give_back_freed_memory()
    ends = Event()
    releasing = Thread(target=_release_until, args=(ends,), daemon=True)
    releasing.start()
    token = _folder.set(folder)
    try:
        yield
    finally:
        _folder.reset(token)
        ends.set()
        releasing.join()


def set_aside(values: NDArray[ScalarT]) -> NDArray[ScalarT]:
    """Return an array that is no longer changed, and that is next looked at after other work.

    Within `columns_in_files` it is a copy in a file, which cannot be changed; else it is the array itself.

    Raises
    ------
    OripError
        If the file cannot be written.
    """
    if _folder.get() is None or values.nbytes < _LEAST_BYTES or 0 in values.strides:
        return values
    column = ColumnByParts(values.dtype)
    column.append(values)
    return column.whole().reshape(values.shape)


class ColumnByParts(Generic[ScalarT]):
    """A column (n,) that is made part after part, and set aside: no more than a part need be in memory.

    Its methods raise OripError if the file cannot be written.
    """

    def __init__(self, dtype: np.dtype[ScalarT]) -> None:
        self._dtype, self._folder, self._parts = dtype, _folder.get(), list[NDArray[Any]]()
        if self._folder is not None:
            with _told(self._folder):
                self._file = tempfile.TemporaryFile(dir=self._folder, buffering=0)  # noqa: SIM115  # until it is whole

    def append(self, part: NDArray[Any]) -> None:
        """Append elements; those of a table row by row."""
        values = part.astype(self._dtype, copy=False)
        if self._folder is None:
            self._parts.append(values)
            return
        with _told(self._folder):
            values.tofile(self._file)

    def whole(self) -> NDArray[ScalarT]:
        """Return the column; nothing can be appended any more."""
        if self._folder is None:
            return np.concatenate([np.zeros(0, dtype=self._dtype), *(part.ravel() for part in self._parts)])
        with _told(self._folder), self._file:
            if not os.fstat(self._file.fileno()).st_size:
                return np.zeros(0, dtype=self._dtype)
            mapping = mmap.mmap(self._file.fileno(), 0, access=mmap.ACCESS_READ)
        with _alone:
            _mappings.add(mapping)
        return np.frombuffer(mapping, dtype=self._dtype)


@contextmanager
def _told(folder: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        message = f"{folder} has no room for the columns of the block ({error.strerror or error}); make room there"
        raise OripError(message) from error


def _release_until(ends: Event) -> None:
    """Give back the memory of all that is set aside, again and again; it is read again when it is next looked at.

    The system does the same where it lacks memory, but counts until then all that was ever looked at.
    """
    while not ends.wait(_LOOKED_AT_SECONDS):
        with _alone:
            mappings = list(_mappings)
        for mapping in mappings:
            with suppress(AttributeError, OSError):  # some systems have no such advice
                mapping.madvise(mmap.MADV_DONTNEED)
