"""Whether the workers still get on with what they were given, and what to say where they do not."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from msgspec import Struct, field

from orip.archive.cluster.connection import LostClusterError

LOOK_SECONDS = 5.0
"""Seconds from one look to the next."""

_MOST_LONELY = 36
"""Looks without any worker: Dask starts those of its own again, which takes more than a minute on a busy machine."""

_MOST_FULL = 24
"""Looks at which all workers had stopped because their memory is full."""

_MOST_IDLE = 120
"""Looks at which no worker computed anything, or passed it on."""

_DEATHS_A_WORKER = 2
"""Workers that may die for each that is there, before what is waited for is given up."""


class WorkerWatch(Struct):
    """The workers as they were seen while one result is waited for.

    Parameters
    ----------
    needed : int
        Bytes that each worker needs at least.
    """

    needed: int
    seen: dict[str, Mapping[str, Any]] = field(default_factory=dict)
    most: int = 0
    lonely: int = 0
    full: int = 0
    idle: int = 0

    def look(self, workers: Mapping[str, Mapping[str, Any]]) -> None:
        """Look at the workers, by their addresses, as the scheduler describes them.

        Raises
        ------
        LostClusterError
            If there is none for a while, if they die again and again, or have all come to a standstill.
        """
        self.seen.update(workers)
        self.most = max(self.most, len(workers))
        self.lonely = 0 if workers else self.lonely + 1
        self.full = self.full + 1 if workers and all(map(_is_full, workers.values())) else 0
        self.idle = self.idle + 1 if workers and not any(map(_is_busy, workers.values())) else 0
        if self.lonely >= _MOST_LONELY:
            message = "no worker is left; start workers again, and repeat the command: it begins from the start"
            raise LostClusterError(message)
        if trouble := self._trouble(len(self.seen) - len(workers)):
            message = f"{trouble}; {memory_advice(self.needed, self.seen)}"
            raise LostClusterError(message)

    def _trouble(self, dead: int) -> str:
        """Return why the workers will not get on; "" if they do."""
        if dead > _DEATHS_A_WORKER * self.most:
            return f"workers died again and again, {dead} of them in one pass over the block"
        if self.full >= _MOST_FULL:
            return "all workers have stopped, for their memory is full"
        if self.idle >= _MOST_IDLE:
            return f"no worker has computed anything for {_MOST_IDLE * LOOK_SECONDS / 60.0:.0f} minutes"
        return ""


def memory_advice(needed: int, workers: Mapping[str, Mapping[str, Any]]) -> str:
    """Return what to do where workers die or stand still, with the memory they have and need.

    More workers are of no use to one that has no room for the largest front.
    """
    limits = [worker["memory_limit"] for worker in workers.values() if worker.get("memory_limit")]
    least = min(limits, default=0)
    has = f"each may use {least / 1e6:.0f} MB, and" if limits else "each"
    more = "give each more (--worker-memory, or --memory-limit of 'dask worker')"
    need = f"{has} needs {needed / 1e6:.0f} MB at the least for this block"
    if 0 < least < needed:
        return f"{need}, however many there are: {more}"
    return f"{need}: {more}, or take more workers on further machines"


def _is_full(worker: Mapping[str, Any]) -> bool:
    return bool(worker.get("status") == "paused")


def _is_busy(worker: Mapping[str, Any]) -> bool:
    """Return whether a worker computes, or receives or passes on what others computed."""
    metrics = worker.get("metrics", {})
    counts, transfers = metrics.get("task_counts", {}), metrics.get("transfer", {})
    return any(counts.get(state) for state in ("executing", "flight")) or any(
        transfers.get(kind) for kind in ("incoming_count", "outgoing_count")
    )
