"""What becomes of memory that is freed: it goes back to the system, or is kept for the arrays that come next.

The system clears memory before it gives it: iterations whose arrays are made anew each time spent a tenth of their time
on that.
"""

from __future__ import annotations

import sys
from contextlib import suppress
from functools import lru_cache
from threading import Event

_M_TRIM_THRESHOLD, _M_MMAP_THRESHOLD = -1, -3
"""Of glibc's mallopt: how much free memory at the end is kept, and the size from which an array has pages of its own,
which the system gets back as soon as they are freed."""

_KEPT, _MOST_KEPT_AT_ONCE = 256 << 20, 64 << 20
_GIVEN_BACK = 1 << 18

_is_given_back = Event()


@lru_cache(maxsize=1)
def keep_freed_memory() -> None:
    """Keep the memory of arrays that are freed from now on, unless it is given back: not of the largest ones."""
    if not _is_given_back.is_set():
        _set(_M_MMAP_THRESHOLD, _MOST_KEPT_AT_ONCE)
        _set(_M_TRIM_THRESHOLD, _KEPT)


def give_back_freed_memory() -> None:
    """Give back the memory of all arrays that are freed from now on."""
    _is_given_back.set()
    _set(_M_MMAP_THRESHOLD, _GIVEN_BACK)
    _set(_M_TRIM_THRESHOLD, _GIVEN_BACK)


def _set(parameter: int, size: int) -> None:
    import ctypes

    if sys.platform == "linux":
        with suppress(OSError, AttributeError):  # another C library
            ctypes.CDLL(None).mallopt(parameter, size)
