"""Passes over a dissection tree as graphs of Dask."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING, Any

from msgspec import Struct

from orip.adjustment.factorisation.dissection import DissectionTree, Node
from orip.archive.cluster.connection import LostClusterError, UnfitWorkerError, lost_cluster
from orip.archive.cluster.worker_tasks import (
    Argument,
    GroupTask,
    StoredTask,
    TaskFile,
    Values,
    array_bytes,
    part_of,
    read_values,
    run_downward,
    run_each,
    run_upward,
    stored_tasks,
)
from orip.archive.cluster.worker_watch import LOOK_SECONDS, WorkerWatch, memory_advice
from orip.errors import OripError
from orip.structs import replace

if TYPE_CHECKING:
    from distributed import Client, Future


_PROCESS_BYTES, _COPIES = 250_000_000, 6
"""What a worker needs: for its programs and photo points, and squares of the largest front while that is computed."""


def grouped(tree: DissectionTree, most: int) -> tuple[tuple[int, ...], ...]:
    """Return the largest subtrees whose fronts have so many bytes at most, and each node above them by itself.

    The fronts above are the largest of all, and no worker has room for all of them.
    """
    sizes, count = [front_bytes(node) for node in tree.nodes], [1] * len(tree)
    for number, node in enumerate(tree.nodes):
        sizes[number] += sum(sizes[child] for child in node.children)
        count[number] += sum(count[child] for child in node.children)
    return tuple(
        tuple(range(number - count[number] + 1, number + 1)) if sizes[number] <= most else (number,)
        for number, node in enumerate(tree.nodes)
        if sizes[number] > most or node.parent < 0 or sizes[node.parent] > most
    )


def front_bytes(node: Node) -> int:
    """Return the bytes of the triangle of a node's front."""
    size = len(node.own) + len(node.border)
    return 4 * size * (size + 1)


def least_memory(tree: DissectionTree) -> int:
    """Return the bytes without which a worker cannot compute the largest front of a tree."""
    return _PROCESS_BYTES + _COPIES * 2 * max(map(front_bytes, tree.nodes))


# The lower parts of the tree are one task each, and so is every node above them. What a task returns stays with the
# worker; where that dies, Dask computes it again from what it was computed from: files that the workers read. The
# scheduler keeps nothing that grows with the number of photo points.

_PARTS_A_WORKER = 2
"""Parts of the tree for each worker: the more, the evener the work, and the more messages."""

_PIECES = 40
"""Parts that would fill the memory of a worker: it has copies of what it computes, sends, or writes to the disk."""

_AGAIN = "it begins from the start"


class Spot(Struct, frozen=True):
    """Values of nodes that are with the workers.

    Parameters
    ----------
    futures : tuple of Future
        One for each group of nodes.
    groups : tuple of tuples of int
        Numbers of these nodes, ascending.
    files : frozenset of TaskFile
        From which the values can be computed again.
    """

    futures: tuple[Future, ...]
    groups: tuple[tuple[int, ...], ...]
    files: frozenset[TaskFile]


class Sent(Struct):
    """Bytes of values that were sent to the cluster, and of those that came back."""

    there: int = 0
    back: int = 0


class DaskPasses(Struct, frozen=True):
    """Passes over a tree by the workers of a client.

    Parameters
    ----------
    groups : tuple of tuples of int
        Numbers of the nodes that are computed together, ascending: parts of the tree, and single nodes above these.
    folder : Path
        Where client and workers read and write.
    """

    client: Client
    tree: DissectionTree
    groups: tuple[tuple[int, ...], ...]
    sent: Sent
    folder: Path

    def kept(self, items: Sequence[Any]) -> Spot:
        """Send values of nodes to the workers that are to compute these."""
        with self._told():
            file = self._stored([items[node] for node in nodes] for nodes in self.groups)
            workers = sorted(self.client.scheduler_info(n_workers=-1)["workers"])
            futures = []
            for number, task in enumerate(file.tasks):
                # where there is none at the moment, Dask waits for one
                chosen = [workers[number * len(workers) // len(self.groups)]] if workers else None
                futures.append(
                    self.client.submit(
                        read_values, task, workers=chosen, allow_other_workers=chosen is not None, pure=False
                    )
                )
            return Spot(tuple(futures), self.groups, frozenset({file}))

    def each(self, function: Callable[..., Any], *items: Any, only: Sequence[int] | None = None) -> Spot:
        """Apply a function to every node, or to some, which are in ascending order."""
        with self._told():
            chosen = [nodes if only is None else tuple(node for node in only if node in nodes) for nodes in self.groups]
            numbers = [number for number, nodes in enumerate(chosen) if nodes]

            def tasks() -> Iterator[GroupTask]:
                for number in numbers:
                    nodes, some = self.groups[number], chosen[number]
                    values = nodes if only is None else [only.index(node) for node in some]
                    task = self._task(function, number, items, values)
                    yield task if only is None else replace(task, chosen=[nodes.index(node) for node in some])

            file = self._stored(tasks())
            futures = [
                self._submit(run_each, task, _arguments(items, number))
                for task, number in zip(file.tasks, numbers, strict=True)
            ]
            return Spot(tuple(futures), tuple(chosen[number] for number in numbers), _lineage(file, items))

    def upward(self, function: Callable[..., tuple[Any, Any]], *items: Any) -> Spot:
        """Apply a function from the bottom up."""
        with self._told():

            def tasks() -> Iterator[GroupTask]:
                given = len(_arguments(items, 0))
                for number, nodes in enumerate(self.groups):
                    task = self._task(function, number, items, nodes)
                    outside = self._children_outside(nodes)
                    yield replace(task, passed={child: given + place for place, child in enumerate(outside)})

            file = self._stored(tasks())
            kept: list[Any] = []
            passed: dict[int, Any] = {}
            for number, nodes in enumerate(self.groups):
                arguments = [*_arguments(items, number), *map(passed.pop, self._children_outside(nodes))]
                found = self._submit(run_upward, file.tasks[number], arguments)
                kept.append(self._part(found, 0))
                if self.tree.nodes[nodes[-1]].parent >= 0:
                    passed[nodes[-1]] = self._part(found, 1)
            return Spot(tuple(kept), self.groups, _lineage(file, items))

    def downward(self, function: Callable[..., tuple[Any, Sequence[Any]]], *items: Any) -> Spot:
        """Apply a function from the root down."""
        with self._told():

            def tasks() -> Iterator[GroupTask]:
                place = len(_arguments(items, 0))
                for number, nodes in enumerate(self.groups):
                    task = self._task(function, number, items, nodes)
                    yield task if self.tree.nodes[nodes[-1]].parent < 0 else replace(task, given=place)

            file = self._stored(tasks())
            kept: list[Any] = []
            passed: dict[int, Any] = {}
            for number, nodes in reversed(list(enumerate(self.groups))):
                arguments = _arguments(items, number)
                if nodes[-1] in passed:
                    arguments.append(passed.pop(nodes[-1]))
                found = self._submit(run_downward, file.tasks[number], arguments)
                kept.append(self._part(found, 0))
                for place, child in enumerate(sorted(self._children_outside(nodes))):
                    passed[child] = self._part(found, 1 + place)
            return Spot(tuple(reversed(kept)), self.groups, _lineage(file, items))

    def gathered(self, handles: Spot) -> Iterator[Any]:
        """Yield the values of handles in the order of the nodes; those of one group are here at a time."""
        watch = WorkerWatch(least_memory(self.tree))
        for future in handles.futures:
            with self._told():
                found = self._fetched(future, watch)
            self.sent.back += array_bytes(found)
            yield from found

    def _fetched(self, future: Future, watch: WorkerWatch) -> Values:
        """Return the value of a future, as long as the workers get on with it.

        A worker may die when its value is there: it is computed again then, and whether others do so is watched, too.
        """
        fetching = asyncio.run_coroutine_threadsafe(
            self.client.gather(future, asynchronous=True), self.client.loop.asyncio_loop
        )
        try:
            while True:
                try:
                    found: Values = fetching.result(timeout=LOOK_SECONDS)
                except TimeoutError:
                    if fetching.done():
                        raise
                    watch.look(self.client.scheduler_info(n_workers=-1)["workers"])
                    self._free_from_the_dead()
                else:
                    return found
        finally:
            fetching.cancel()

    def _free_from_the_dead(self) -> None:
        """Let other workers compute what was to be where a worker died.

        Dask does so by itself, but not with what waited while there was no worker at all.
        """

        # a function within a function is sent as it is: the scheduler may have no orip
        def free(dask_scheduler: Any) -> None:
            waiting = [task for task in dask_scheduler.unrunnable if task.loose_restrictions]
            if waiting and dask_scheduler.running:
                for task in waiting:
                    task.worker_restrictions = None
                dask_scheduler.transitions({task.key: "waiting" for task in waiting}, "orip-workers-are-there-again")

        self.client.run_on_scheduler(free)

    @contextmanager
    def _told(self) -> Iterator[None]:
        """Say what went wrong with the cluster in terms of what to do.

        Raises
        ------
        LostClusterError
            If the scheduler, or all workers, are gone, or workers die again and again.
        OripError
            If a worker is not fit.
        """
        from asyncio import CancelledError
        from concurrent.futures import CancelledError as FetchCancelledError

        try:
            yield
        except OripError:
            raise
        except UnfitWorkerError as error:
            raise OripError(str(error)) from None
        except (CancelledError, FetchCancelledError, OSError, TimeoutError) as error:
            raise lost_cluster(self.client, _AGAIN) from error
        except Exception as error:
            if self.client.status != "running":
                raise lost_cluster(self.client, _AGAIN) from error
            if type(error).__name__ == "KilledWorker":
                workers = self.client.scheduler_info(n_workers=-1)["workers"]
                message = f"workers died again and again; {memory_advice(least_memory(self.tree), workers)}"
                raise LostClusterError(message) from None
            raise

    def _children_outside(self, nodes: Sequence[int]) -> list[int]:
        inside = set(nodes)
        return [child for node in nodes for child in self.tree.nodes[node].children if child not in inside]

    def _task(
        self, function: Callable[..., Any], number: int, items: Sequence[Any], values: Sequence[int]
    ) -> GroupTask:
        """Return the task of a group; its arguments are those of `_arguments`."""
        arguments = count()
        of_task = [
            Argument(next(arguments)) if isinstance(item, Spot) else [item[value] for value in values] for item in items
        ]
        topology = [(node, self.tree.nodes[node].children) for node in self.groups[number]]
        return GroupTask(function, topology, of_task)

    def _part(self, found: Future, which: int) -> Future:
        return self.client.submit(part_of, found, which, pure=False)

    def _submit(self, run: Callable[..., Any], task: StoredTask, arguments: Sequence[Future]) -> Future:
        return self.client.submit(run, task, *arguments, pure=False)

    def _stored(self, tasks: Iterable[Any]) -> TaskFile:
        """Write what is sent to the workers."""
        file = stored_tasks(self.folder, tasks)
        self.sent.there += file.bytes
        return file


def _arguments(items: Sequence[Any], number: int) -> list[Future]:
    """Return the futures that are arguments of the task of a group."""
    return [item.futures[number] for item in items if isinstance(item, Spot)]


def _lineage(file: TaskFile, items: Sequence[Any]) -> frozenset[TaskFile]:
    """Return the files from which the results of a pass can be computed again."""
    return frozenset({file}).union(*(item.files for item in items if isinstance(item, Spot)))


def dask_passes(client: Client, tree: DissectionTree, sent: Sent, folder: Path) -> DaskPasses:
    """Return the passes of a tree over the workers of a client; both read and write in a folder.

    Raises
    ------
    OripError
        If workers have less memory than the largest front needs.
    """
    workers = client.scheduler_info(n_workers=-1)["workers"]
    limits = [worker["memory_limit"] for worker in workers.values() if worker["memory_limit"]]
    if limits and min(limits) < least_memory(tree):
        message = f"the workers are too small; {memory_advice(least_memory(tree), workers)}"
        raise OripError(message)
    even = sum(map(front_bytes, tree.nodes)) // (_PARTS_A_WORKER * max(len(workers), 1))
    return DaskPasses(client, tree, grouped(tree, min([even, *(limit // _PIECES for limit in limits)])), sent, folder)
