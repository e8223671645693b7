"""Threads that share the work of one computation, whose result does not depend on how many there are."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar, copy_context
from typing import TypeVar

T = TypeVar("T")

VARIABLE = "OMP_NUM_THREADS"
"""The variable that limits the threads of numerical programs; a list has the number of each level."""
MOST_THREADS = 256

_limit: ContextVar[int | None] = ContextVar("limit", default=None)


def available_threads() -> int:
    """Return how many threads may work: what `limited_threads` says, else OMP_NUM_THREADS, else all processors."""
    limit = _limit.get()
    if limit is None:
        given = os.environ.get(VARIABLE, "").partition(",")[0].strip()
        limit = int(given) if given.isdecimal() else 0
    return min(limit or _processors(), MOST_THREADS)


@contextmanager
def limited_threads(limit: int | None) -> Iterator[None]:
    """Let at most so many threads work within the block; None: as many as without it.

    BLAS has one: what it computes depends on how many it has, and small systems take longer with more.
    """
    from threadpoolctl import threadpool_limits

    token = _limit.set(_limit.get() if limit is None else limit)
    try:
        with threadpool_limits(1):
            yield
    finally:
        _limit.reset(token)


def at_once(tasks: Sequence[Callable[[], T]]) -> list[T]:
    """Return what tasks return that are done at the same time, the first one by the calling thread.

    The threads end with their tasks: a process that forks later has none.
    """
    from concurrent.futures import ThreadPoolExecutor

    if len(tasks) == 1:
        return [tasks[0]()]
    with ThreadPoolExecutor(len(tasks) - 1) as pool:
        others = [pool.submit(copy_context().run, task) for task in tasks[1:]]
        first = tasks[0]()
        return [first, *(other.result() for other in others)]


def _processors() -> int:
    """Return the number of processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
