"""Long columns that are set aside: in files from which the system reads what is asked for, and not in memory.

A column has a number or a few for every photo point, and a block may have more photo points than there is memory for.
What is set aside within `columns_in_files` is written to a file without a name, which goes with the array, and mapped:
it takes memory only while it is looked at. Elsewhere arrays stay as they are.
"""

from __future__ import annotations

import mmap
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path
from typing import TypeVar
from weakref import WeakSet

import numpy as np
from numpy.typing import NDArray

from orip.errors import OripError

ScalarT = TypeVar("ScalarT", bound=np.generic)

_LEAST_BYTES = 1 << 18
"""A shorter array stays in memory: a file takes longer, and there are many more short ones."""

_folder: ContextVar[Path | None] = ContextVar("folder", default=None)
_mappings: WeakSet[mmap.mmap] = WeakSet()


@contextmanager
def columns_in_files(folder: Path) -> Iterator[None]:
    """Keep in files of a folder what is set aside within the block."""
    token = _folder.set(folder)
    try:
        yield
    finally:
        _folder.reset(token)


def set_aside(values: NDArray[ScalarT]) -> NDArray[ScalarT]:
    """Return an array that is no longer changed, and that is next looked at after other work.

    Within `columns_in_files` it is a copy that cannot be changed, in a file; all arrays that were set aside before
    give up the memory that they took since. Else it is the array itself.

    Raises
    ------
    OripError
        If the file cannot be written.
    """
    folder = _folder.get()
    if folder is None or values.nbytes < _LEAST_BYTES or 0 in values.strides:
        return values
    try:
        folder.mkdir(exist_ok=True)
        with tempfile.TemporaryFile(dir=folder, buffering=0) as file:
            values.tofile(file)
            mapping = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
    except OSError as error:
        message = f"{folder} has no room for the columns of the block ({error.strerror or error}); make room there"
        raise OripError(message) from error
    release()
    _mappings.add(mapping)
    return np.frombuffer(mapping, dtype=values.dtype).reshape(values.shape)


def release() -> None:
    """Give back the memory of all that was set aside; it is read again when it is next looked at."""
    if hasattr(mmap, "MADV_DONTNEED"):
        for mapping in list(_mappings):
            mapping.madvise(mmap.MADV_DONTNEED)
