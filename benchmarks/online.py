"""How long one observation takes to be tested, taken in and taken out of a block that is being measured.

    OPENBLAS_NUM_THREADS=1 python benchmarks/online.py 50 500

Blocks of `aerial_blocks.py` with 40 points a photo (2000 rays at 50 photos, 20 000 at 500), linearised at the values
that they were made from. Rays are taken out and in again: those of the last two strips, as at an instrument, and then
any of the block. Percentiles of the wall-clock time of each, in milliseconds.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from aerial_blocks import aerial_block
from threadpoolctl import threadpool_limits

from orip.bundle.problem import starting_state
from orip.sequential.observation_rows import ObservationKey, ReducedColumns, linearised, tied_points
from orip.sequential.sequential_block import SequentialBlock

POINTS_A_PHOTO = 40
RAYS = 100


def _timed(action: Callable[[], object]) -> float:
    start = time.perf_counter()
    action()
    return 1000.0 * (time.perf_counter() - start)


def _percentiles(name: str, times: list[float]) -> None:
    middle, high, largest = np.percentile(times, [50, 95, 100])
    print(f"  {name:<34} p50 {middle:8.2f}   p95 {high:8.2f}   max {largest:8.2f} ms")


def _measure(photos: int) -> None:
    block = aerial_block(photos, POINTS_A_PHOTO)
    # additional unknowns of the camera are held while measuring
    block = replace(block, cameras=tuple(replace(camera, unknown=()) for camera in block.cameras))
    columns, made = ReducedColumns(), SequentialBlock[ObservationKey]()
    start = time.perf_counter()
    rows = linearised(block, starting_state(block), tied_points(block), columns)
    made.append(len(columns.names))
    between = time.perf_counter()
    made.relinearise(rows)
    built = time.perf_counter()
    rays = [key for key in rows if key.kind == "photo"]
    print(f"{photos} photos, {len(rays)} rays, {len(columns.names)} reduced unknowns")
    print(f"  all equations {between - start:.2f} s, triangle of all {built - between:.2f} s")
    last = {photo.name for photo in block.photos[-photos // 4 :]}
    random = np.random.default_rng(1)
    for where, of in (("last photos", [key for key in rays if key.photo in last]), ("any photo", rays)):
        chosen = [of[row] for row in random.choice(len(of), size=min(RAYS, len(of)), replace=False)]
        out, tested, taken = [], [], []
        for key in chosen:
            out.append(_timed(lambda key=key: made.exclude(key)))
            tested.append(_timed(lambda key=key: made.trial(key, rows[key])))
            taken.append(_timed(lambda key=key: made.include(key, rows[key])))
        _percentiles(f"test a ray, {where}", tested)
        _percentiles(f"take it in, {where}", taken)
        _percentiles(f"take one out, {where}", out)
    print(f"  triangle built {made.rebuilt} times")


if __name__ == "__main__":
    with threadpool_limits(1, user_api="blas"):
        for argument in sys.argv[1:] or ["50"]:
            _measure(int(argument))
