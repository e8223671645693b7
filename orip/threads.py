"""Threads that share the work of one computation, whose result does not depend on how many there are; freed memory.

The system clears memory before it gives it: iterations whose arrays are made anew each time spent a tenth of their time
on that.
"""

from __future__ import annotations

import _thread
import os
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from contextvars import ContextVar, copy_context
from functools import lru_cache
from threading import Event, Lock
from typing import TYPE_CHECKING, Generic, TypeVar

if TYPE_CHECKING:
    from threadpoolctl import ThreadpoolController


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


T = TypeVar("T")
PartT = TypeVar("PartT")

VARIABLE = "OMP_NUM_THREADS"
"""The variable that limits the threads of numerical programs; a list has the number of each level."""
MOST_THREADS = 256

_PARTS_OF_A_THREAD = 4
"""Parts of many thousand elements for which a thread pays: a few operations on each take about a millisecond."""

BEGINS_WITHIN_S = 20.0
"""Seconds within which a thread begins on the busiest of machines."""

_limit: ContextVar[int | None] = ContextVar("limit", default=None)


def available_threads() -> int:
    """Return how many threads may work: what `limited_threads` says, else OMP_NUM_THREADS, else all processors."""
    limit = _limit.get()
    if limit is None:
        given = os.environ.get(VARIABLE, "").partition(",")[0].strip()
        limit = int(given) if given.isdecimal() else 0
    return min(limit or processors(), MOST_THREADS)


@contextmanager
def limited_threads(limit: int | None) -> Iterator[None]:
    """Let at most so many threads work within the block; None: as many as without it.

    BLAS has one: what it computes depends on how many it has, and small systems take longer with more. Memory that is
    freed is kept for the next arrays.
    """
    keep_freed_memory()
    token = _limit.set(_limit.get() if limit is None else limit)
    try:
        with _libraries(len(sys.modules)).limit(limits=1):
            yield
    finally:
        _limit.reset(token)


@lru_cache(maxsize=1)
def _libraries(_modules: int) -> ThreadpoolController:
    """Return what limits the threads of the libraries that are loaded; a further one comes with a further module."""
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController()


def begin_thread(task: Callable[[], None], purpose: str) -> None:
    """Begin a thread that does a task beside the calling one, and does not keep the program from ending.

    `Thread.start` waits for ever where the new thread has no memory to begin with.

    Parameters
    ----------
    task : callable
        Catches its errors, and tells them whom they concern.
    purpose : str
        What cannot be done without it.

    Raises
    ------
    MemoryError
        If the system allows no further thread, or lacks the memory for it.
    """
    has_begun = Event()

    def begin() -> None:
        has_begun.set()
        task()

    try:
        _thread.start_new_thread(begin, ())
        if has_begun.wait(BEGINS_WITHIN_S):
            return
    except (RuntimeError, MemoryError):
        pass
    message = f"no thread for {purpose}: memory or the number of threads is limited; allow more of them"
    raise MemoryError(message)


def at_once(tasks: Sequence[Callable[[], T]]) -> list[T]:
    """Return what tasks return that are done at the same time, the first one by the calling thread.

    The threads end with their tasks: a process that forks later has none. What no thread has begun when the first task
    is done, as where the system allows no further thread, the calling one does. Of several errors the first one is
    raised.
    """
    helpers = [_Helper(task) for task in tasks[1:]]
    for helper in helpers:
        helper.begin()
    try:
        first = tasks[0]()
    finally:
        for helper in helpers:
            helper.end()
    return [first, *(helper.result() for helper in helpers)]


def by_threads(task: Callable[[PartT], T], parts: Iterable[PartT], of_a_thread: int | None = None) -> list[T]:
    """Return what a task returns of each part, in their order; a thread takes one part after the other.

    A task that writes to its part of an array leaves the others alone: nothing depends on how many threads there are.

    Parameters
    ----------
    of_a_thread : int, optional
        For so many parts a thread pays; if not given, for so many of many thousand elements (`orip.arrays.parts`).
    """
    given = list(parts)
    waiting, found = iter(enumerate(given)), dict[int, T]()

    def take_parts() -> None:
        for number, part in waiting:
            found[number] = task(part)

    at_once([take_parts] * max(1, min(available_threads(), len(given) // (of_a_thread or _PARTS_OF_A_THREAD))))
    return [found[number] for number in range(len(given))]


class _Helper(Generic[T]):
    """A thread that does a task with the settings of the thread that made it.

    Unlike `threading.Thread` nobody waits until it begins, which takes as long as a short task, and for ever where the
    new thread has no memory to begin with.
    """

    def __init__(self, task: Callable[[], T]) -> None:
        self._task, self._context = task, copy_context()
        self._begun, self._ended = Lock(), Lock()
        self._ended.acquire()
        self._found: list[T] = []
        self._error: BaseException | None = None

    def begin(self) -> None:
        """Begin a thread, if the system has one."""
        with suppress(RuntimeError, MemoryError):
            _thread.start_new_thread(self._run, ())

    def _run(self) -> None:
        """Do the task, unless another thread has begun it."""
        if not self._begun.acquire(blocking=False):
            return
        try:
            self._found.append(self._context.run(self._task))
        except BaseException as error:  # noqa: BLE001  # it is raised where the result is asked for
            self._error = error
        finally:
            self._ended.release()

    def end(self) -> None:
        """Wait for the end of the task."""
        self._run()
        with self._ended:
            pass

    def result(self) -> T:
        """Return what the task returned, or raise its error."""
        if self._error is not None:
            raise self._error
        return self._found[0]


def processors() -> int:
    """Return the number of processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
