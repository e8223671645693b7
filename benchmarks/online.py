"""How long a measurement takes to be answered, and one observation to be tested, taken in and taken out.

    OPENBLAS_NUM_THREADS=1 python benchmarks/online.py 50 500

**Answers**: a session is begun with all photos of a simulated block except the last three (5 x 10 photos and 2000 rays,
20 x 25 and 20 000), whose points are then measured. Each answer has what `orip online` computes for it: preliminary
values, equations, tests, and what to measure next. Percentiles of the clock and of the processor's time, which differ
on a machine that is used otherwise; the file of the measurements is not written. What is reconsidered afterwards is
timed alone. Then each control point is left out and taken in again, and what `show` takes.

**Equations**: blocks of `aerial_blocks.py` with 40 points a photo, linearised at the values that they were made from.
Rays are taken out and in again: those of the last two strips, as at an instrument, and then any of the block.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable

import numpy as np
from aerial_blocks import aerial_block
from threadpoolctl import threadpool_limits

from orip.bundle.starting_state import starting_state
from orip.online.block.online_block import OnlineBlock
from orip.online.fit import residuals_of, statistics_of
from orip.online.measuring import Measuring
from orip.online.replies import photos_of, points_of
from orip.online.sequential.observation_rows import ObservationKey, ReducedColumns, linearised, tied_points
from orip.online.sequential.sequential_block import SequentialBlock
from orip.online.simulation import simulated_session
from orip.records.measurement import PhotoObservations
from orip.structs import replace

POINTS_A_PHOTO = 40
RAYS = 100
LAST_PHOTOS = 3
TODO = 20


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


def _answer(photos: int) -> None:
    strips = max(1, round((photos / 2) ** 0.5))
    session = simulated_session(strips, -(-photos // strips), 0, points_a_place=5)
    names = list(dict.fromkeys(photo for photo, _, _ in session.measurements))
    before = [one for one in session.measurements if one[0] not in names[-LAST_PHOTOS:]]
    rest = [one for one in session.measurements if one[0] in names[-LAST_PHOTOS:]]
    photo, point, xy = zip(*before, strict=True)
    count = len(before)
    given = PhotoObservations(
        session.inputs.definition.name, photo, point, np.array(xy), np.full((count, 2), np.nan), np.zeros(count, bool)
    )
    measured = replace(session.inputs.measured, observations={given.bundle: given})
    start = time.perf_counter()
    measuring = Measuring(OnlineBlock(replace(session.inputs, measured=measured)))
    print(f"{len(names)} photos, {len(session.measurements)} rays")
    print(f"  begun with {count} rays in {time.perf_counter() - start:.2f} s")
    clock, processor, later = [], [], []
    for measurement in rest:
        began = time.process_time()
        clock.append(_timed(lambda measurement=measurement: measuring.measure(measurement)))
        processor.append(1000.0 * (time.process_time() - began))
        began = time.process_time()
        measuring.reconsider()
        later.append(1000.0 * (time.process_time() - began))
    _given(measuring)
    _percentiles("answer", clock)
    _percentiles("answer, processor's time", processor)
    _percentiles("after the answer, processor's time", later)
    shown: dict[str, Callable[[], object]] = {
        "photos": lambda: photos_of(measuring),
        "points": lambda: points_of(measuring),
        "statistics": lambda: statistics_of(measuring),
        "todo": lambda: measuring.next(measuring.block.measurements.photos, TODO),
        "residuals": lambda: residuals_of(measuring),
        "residuals of a photo": lambda: residuals_of(measuring, names[-1]),
    }
    for name, show in shown.items():
        began = time.process_time()
        show()
        print(f"  {f'show {name}, processor':<36} {1000.0 * (time.process_time() - began):8.0f} ms")


def _given(measuring: Measuring) -> None:
    """Leave every control point out and take it in again, and compare with the triangle built anew."""
    equations, times, rebuilt = measuring.block.equations, [], measuring.block.equations.rebuilt
    for key in [key for key in equations.included if key.kind == "control"]:
        began = time.process_time()
        measuring.leave_out(key)
        measuring.take_in(key)
        times.append(1000.0 * (time.process_time() - began))
    _percentiles("control out and in, processor's time", times)
    print(f"  triangle built {equations.rebuilt - rebuilt} times")
    found = equations.triangle.solution()
    equations.rebuild()
    sd = np.sqrt(np.diagonal(equations.triangle.cofactors()))
    worst = np.max(np.abs(found - equations.triangle.solution())[sd > 0.0] / sd[sd > 0.0])
    print(f"  off the batch by {worst:.1e} standard deviations at most")


if __name__ == "__main__":
    with threadpool_limits(1, user_api="blas"):
        for argument in sys.argv[1:] or ["50"]:
            _answer(int(argument))
            _measure(int(argument))
