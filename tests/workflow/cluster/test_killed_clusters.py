"""Workers and schedulers that are killed while a block is adjusted."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import threading
import time

import pytest
from bundle.blocking.divided_blocks import calibrated, largest_difference

from orip.bundle.compiled.photo_loop import is_compiled
from orip.bundle.solve import solve_block
from orip.workflow.cluster.connection import LostClusterError
from orip.workflow.cluster.divided_block import ClusterRequest, divided_blocks

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

        def kill_soon(_: object) -> None:
            threading.Timer(0.3, kill).start()

        divided = solve_block(BLOCK, kill_soon, lambda: False, pose=blocks.pose)
    assert len(set(killed)) >= len(divided.iterations) - 1
    assert len(divided.iterations) == len(whole.iterations)
    assert largest_difference(whole, divided) < 1e-9


def test_a_lost_scheduler_is_told(tmp_path):
    scheduler = subprocess.Popen(
        [sys.executable, "-m", "distributed.cli.dask_scheduler", "--port", "0", "--no-dashboard"],
        stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    address = None
    while address is None:
        found = re.search(r"(tcp://\S+:\d+)", scheduler.stderr.readline())
        address = found and found[1]
    worker = subprocess.Popen(
        [sys.executable, "-m", "distributed.cli.dask_worker", address, "--no-dashboard", "--nthreads", "1"],
        stderr=subprocess.DEVNULL,
    )
    began = time.monotonic()
    try:
        with divided_blocks(ClusterRequest(address), tmp_path) as blocks:
            blocks.largest = 10
            with pytest.raises(LostClusterError, match="no longer answers; start it again and repeat the command"):
                solve_block(BLOCK, lambda _: scheduler.kill(), lambda: False, pose=blocks.pose)
    finally:
        for process in (worker, scheduler):
            process.kill()
            process.communicate()
    assert time.monotonic() - began < 300.0
