"""How fast the real-time loop is: object points a second, all at once, one command after the other, and over TCP.

    python benchmarks/drive.py

The block has five strips of vertical photos, 100 models, and a lens with radial and tangential distortion; the points
are a raster that crosses the frame lines of every strip, and points at random, where the model changes nearly every
time. Prints the best of five, by the CPU time of one core. Over TCP the emulated plate processor runs in a process of
its own, and shares one core with its client; there it is the time on the clock, with DRIVE commands one at a time, each
after the reply to the last, and sent without waiting for replies.
"""

from __future__ import annotations

import os
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from urllib.parse import urlsplit

os.environ["OPENBLAS_NUM_THREADS"] = "1"

import numpy as np

from orip.multimodel.link.client import open_link
from orip.multimodel.movement import drive_object
from orip.multimodel.oriented_block import OrientedBlock
from orip.multimodel.processor import Loaded, load
from orip.multimodel.readout import drive_objects
from orip.multimodel.state import ProcessorState
from orip.multimodel.table_text import drive_table_text
from orip.records.drive_table import DriveCamera, DriveModel, DrivePhoto, DriveTable, StageLimits

TIMES = 5
STRIPS, MODELS = 5, 20
BASE, WIDTH, HEIGHT = 20.0, 48.0, 100.0
POINTS, COMMANDS = 100_000, 5_000


def block(distortion_at: str) -> Loaded:
    """Return the block: frames of 20 x 24 mm, C = 50 mm, so that the frame lines lie in the middle of the overlaps."""
    camera = DriveCamera(
        "CAM", (50.0, 0.1, -0.1, 0.0, -3e-5, 2e-8, 0.0, 0.0, 2e-5, -1e-5, 0.0, 0.0), (20.0, 24.0), distortion_at
    )
    photos, models = [], []
    for row in range(STRIPS):
        for column in range(MODELS + 1):
            stage = "LOWER" if column % 2 else "UPPER"
            centre = (column * BASE, -row * WIDTH, HEIGHT)
            place = (5.0 + 11.0 * column, 1.0, 0.0, 20.0 + 30.0 * row, 0.0, 1.0)
            rotation = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)
            photos.append(DrivePhoto(f"P{row}-{column}", "CAM", None, stage, centre, rotation, place))
        for column in range(MODELS):
            optics = "SWAPPED" if column % 2 else "NORMAL"
            models.append(
                DriveModel(f"M{row}-{column}", row + 1, column + 1, f"P{row}-{column}", f"P{row}-{column + 1}", optics)
            )
    limits = StageLimits(-20.0, 260.0, -20.0, 260.0, 0.001)
    table = DriveTable(
        "MAIN", "BENCHMARK", "", "mm", "m", limits, limits, (camera,), (), tuple(photos), tuple(models), (1.0, 0.0, 0.0)
    )
    loaded = load(table)
    assert isinstance(loaded, Loaded)
    return loaded


def raster() -> np.ndarray:
    """Return points along lines in X, each half a metre beside the last."""
    x = np.linspace(0.5, BASE * MODELS - 0.5, 1000)
    y = np.linspace(-WIDTH * (STRIPS - 0.51), 0.49 * WIDTH, POINTS // len(x))
    return np.array([(a, b, 2.0) for b in y for a in x])


def scattered() -> np.ndarray:
    """Return points at random."""
    random = np.random.default_rng(1)
    low, high = [0.0, -WIDTH * (STRIPS - 0.5), -3.0], [BASE * MODELS, 0.5 * WIDTH, 3.0]
    return random.uniform(low, high, (POINTS, 3))


def seconds(work: Callable[[], object]) -> float:
    """Return the least of some CPU times; a busy machine does not count."""
    times = []
    for _ in range(TIMES):
        start = time.process_time()
        work()
        times.append(time.process_time() - start)
    return min(times)


def one_by_one(block: OrientedBlock, state: ProcessorState, points: list[tuple[float, ...]]) -> None:
    """Drive to points by one command each."""
    for point in points:
        state, _ = drive_object(block, state, point)


@contextmanager
def emulator() -> Iterator[str]:
    """Start an emulated plate processor and yield the link to it."""
    command = [sys.executable, "-m", "orip.cli.main", "drive", "emulate", "--listen", "127.0.0.1:0"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as process:
        assert process.stdout is not None
        try:
            yield process.stdout.readline().split()[-1]
        finally:
            process.terminate()


def request_and_reply(url: str, table: bytes, points: list[tuple[float, ...]]) -> float:
    """Return how many points a second are driven to, each after the reply to the last."""
    with open_link(url) as link:
        link.download(table)
        start = time.perf_counter()
        for x, y, z in points:
            link.drive_object(x, y, z)
        return len(points) / (time.perf_counter() - start)


def pipelined(link: str, points: list[tuple[float, ...]]) -> float:
    """Return how many points a second are driven to when nobody waits for a reply before the next command."""
    parts = urlsplit(link)
    commands = "".join(f"DRIVE OBJECT {x:.4f} {y:.4f} {z:.4f}\n" for x, y, z in points).encode()
    with socket.create_connection((parts.hostname, parts.port)) as connection, connection.makefile("rb") as replies:
        connection.sendall(f"TOKEN {parts.username}\n".encode())
        replies.readline()
        replies.readline()
        start = time.perf_counter()
        sender = threading.Thread(target=connection.sendall, args=(commands,))
        sender.start()
        driven = sum(replies.readline().startswith(b"OK MODEL ") for _ in points)
        sender.join()
        assert driven == len(points)
        return len(points) / (time.perf_counter() - start)


def over_tcp(loaded: Loaded, points: np.ndarray) -> tuple[float, float]:
    """Return the best of some times, one command after the other and pipelined."""
    can_be_driven_to = drive_objects(*loaded, points)[1].code == 0
    some = [tuple(point) for point in points[can_be_driven_to][:COMMANDS].tolist()]
    data = drive_table_text(loaded.block.table).encode()
    with emulator() as link:
        one_by_one = [request_and_reply(link, data, some) for _ in range(TIMES)]
        at_once = [pipelined(link, some) for _ in range(TIMES)]
    return max(one_by_one), max(at_once)


def main() -> None:
    """Measure and print."""
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    print(f"{STRIPS * MODELS} models; points or commands a second of CPU time")
    for distortion_at in ("ideal", "measured"):
        loaded = block(distortion_at)
        for name, points in (("raster", raster()), ("at random", scattered())):
            _, driven = drive_objects(*loaded, points)
            changes = int(np.count_nonzero(np.diff(driven.model)))
            at_once = len(points) / seconds(partial(drive_objects, *loaded, points))
            some = [tuple(point) for point in points[:COMMANDS].tolist()]
            single = COMMANDS / seconds(partial(one_by_one, *loaded, some))
            print(
                f"distortion at {distortion_at:8s}  {name:9s}  at once {at_once:9.0f}   one by one {single:8.0f}   "
                f"{changes} changes of model in {len(points)} points"
            )
    print("DRIVE commands a second over TCP, emulator and client on one core")
    for name, points in (("raster", raster()), ("at random", scattered())):
        single, at_once = over_tcp(block("ideal"), points)
        print(f"{name:9s}  each after the last reply {single:7.0f}   pipelined {at_once:7.0f}")


if __name__ == "__main__":
    main()
