"""A lock on a text of the user's, for edits of texts where there is no store yet that could be locked."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from orip.errors import LockedError
from orip.files.text.regular_file import open_regular

_PAUSE_SECONDS = 0.05


@contextmanager
def locked(path: Path, shown: str, *, timeout: float = 10.0) -> Iterator[None]:
    """Let one process at a time into the block; whoever is killed leaves no lock behind.

    Where the operating system or the disk knows no such locks, the block runs without one.

    Parameters
    ----------
    path : Path
        A file that is there; it is not changed.
    shown : str
        As the user would name it.
    timeout : float
        Seconds to wait for another process.

    Raises
    ------
    LockedError
        If another process holds the lock after `timeout`.
    OSError
        If the file cannot be opened, or is no regular file.
    """
    with open_regular(path) as file:
        deadline = time.monotonic() + timeout
        while not _taken(file):
            if time.monotonic() > deadline:
                message = f"{shown} is locked by another run of orip; wait for it, or end it, and repeat the command"
                raise LockedError(message)
            time.sleep(_PAUSE_SECONDS)
        yield  # closing the file releases the lock


def _taken(file: BinaryIO) -> bool:
    """Take the lock; tell whether nobody else holds it."""
    if sys.platform != "win32":
        import fcntl

        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            return False
        except OSError:  # a disk without locks
            return True
    return True
