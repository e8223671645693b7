"""Workers and schedulers that are killed while a block is adjusted."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress

import pytest
from bundle.blocking.divided_blocks import calibrated, largest_difference

from orip.archive.cluster import dask_passes, worker_watch
from orip.archive.cluster.connection import LostClusterError
from orip.archive.cluster.divided_block import ClusterRequest, DividedBlocks, divided_blocks
from orip.bundle.compiled.photo_loop import is_compiled
from orip.bundle.solve import solve_block

pytest.importorskip("distributed")
pytestmark = [
    pytest.mark.long,
    pytest.mark.timeout(600),
    pytest.mark.skipif(not is_compiled(), reason="sub-blocks need the compiled loop"),
]

BLOCK = calibrated(120)


def test_a_worker_that_is_killed_in_every_iteration_changes_nothing(tmp_path):
    whole = solve_block(BLOCK, lambda _: None, lambda: False)
    killed = []
    with divided_blocks(ClusterRequest(None, 2), tmp_path) as blocks:
        blocks.largest = 10

        def kill() -> None:
            workers = blocks.client.run(os.getpid, on_error="ignore")
            worker = sorted(workers)[len(killed) % len(workers)]
            killed.append(workers[worker])
            os.kill(workers[worker], signal.SIGKILL)

        timers = []

        def kill_soon(_: object) -> None:
            timers.append(threading.Timer(0.3, kill))
            timers[-1].start()

        divided = solve_block(BLOCK, kill_soon, lambda: False, pose=blocks.pose)
        for timer in timers:  # the last one may fire when the block is adjusted already
            timer.join()
    assert len(set(killed)) >= len(divided.iterations) - 1
    assert len(divided.iterations) == len(whole.iterations)
    assert largest_difference(whole, divided) < 1e-9


@contextmanager
def separate_cluster(*worker_words: str) -> Iterator[tuple[str, subprocess.Popen[str], subprocess.Popen[str]]]:
    """Yield the address of a scheduler that was started separately, its process and that of its worker."""
    scheduler = subprocess.Popen(
        [sys.executable, "-m", "distributed.cli.dask_scheduler", "--port", "0", "--no-dashboard"],
        stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    address = None
    while address is None:
        found = re.search(r"(tcp://\S+:\d+)", scheduler.stderr.readline())
        address = found and found[1]
    words = [address, "--no-dashboard", "--nthreads", "1", *worker_words]
    worker = subprocess.Popen(
        [sys.executable, "-m", "distributed.cli.dask_worker", *words], stderr=subprocess.DEVNULL, text=True
    )
    try:
        yield address, scheduler, worker
    finally:
        for process in (worker, scheduler):
            process.kill()
            process.communicate()


def test_a_lost_scheduler_is_told(tmp_path):
    with separate_cluster() as (address, scheduler, _):
        began = time.monotonic()
        with divided_blocks(ClusterRequest(address), tmp_path) as blocks:
            blocks.largest = 10
            with pytest.raises(LostClusterError, match="no longer answers; start it again and repeat the command"):
                solve_block(BLOCK, lambda _: scheduler.kill(), lambda: False, pose=blocks.pose)
    assert time.monotonic() - began < 300.0


def test_a_worker_that_is_gone_is_told(tmp_path, monkeypatch):
    monkeypatch.setattr(dask_passes, "LOOK_SECONDS", 0.5)
    with (
        separate_cluster("--no-nanny") as (address, _, worker),
        divided_blocks(ClusterRequest(address), tmp_path) as blocks,
    ):
        blocks.largest = 10
        with pytest.raises(LostClusterError, match="no worker is left; start workers again, and repeat the command"):
            solve_block(BLOCK, lambda _: worker.kill(), lambda: False, pose=blocks.pose)


def test_workers_that_die_as_soon_as_they_are_there_are_told(tmp_path, monkeypatch):
    monkeypatch.setattr(dask_passes, "LOOK_SECONDS", 0.5)
    monkeypatch.setattr(worker_watch, "_MOST_LONELY", 10**6)
    ended = threading.Event()

    def kill_all(blocks: DividedBlocks) -> None:
        while not ended.wait(0.2):
            with suppress(AttributeError):  # the client is being closed
                for worker in blocks.client.run(os.getpid, on_error="ignore").values():
                    os.kill(worker, signal.SIGKILL)

    with divided_blocks(ClusterRequest(None, 1, 1_000_000_000), tmp_path) as blocks:
        blocks.largest = 10
        killer = threading.Thread(target=kill_all, args=[blocks])
        try:
            with pytest.raises(LostClusterError, match=r"died again.* each may use 1000 MB, and needs \d+ MB"):
                solve_block(BLOCK, lambda _: killer.is_alive() or killer.start(), lambda: False, pose=blocks.pose)
        finally:
            ended.set()
            killer.join()
