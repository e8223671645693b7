"""Blocks for simulation studies: a design with exact observations, noise and blunders put on them, and the truth.

Random numbers are seeded with the name of the design and the number of the run.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable, Iterable
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from typing import TypeVar

import numpy as np
from bundle.aerial_block import PRECISION_MM, aerial_block
from msgspec import Struct
from support.synthetic_block import SyntheticBlock, synthetic_block
from threadpoolctl import threadpool_limits

from orip.bundle.solve import SolvedBlock, solve_block
from orip.records.block import Block
from orip.structs import replace

NO_DOWN_WEIGHTING = {"max_iterations": 30, "start_down_weight": 30}

Item = TypeVar("Item")
Result = TypeVar("Result")


class Blundered(Struct, frozen=True):
    """A block with blunders in some of its photo coordinates; `rows` count x and y of each photo point in turn."""

    block: Block
    rows: np.ndarray
    sizes: np.ndarray


def solved(block: Block) -> SolvedBlock:
    return solve_block(block, lambda _: None, lambda: False)


def design(name: str, geometry: str, **settings: object) -> SyntheticBlock:
    """Return a block without errors: a scene of `synthetic_block`, or "aerial"."""
    if name == "aerial":
        return aerial_block(geometry, **settings)
    return synthetic_block(name, geometry, **{"precision_mm": PRECISION_MM, **settings})


def random_numbers(purpose: str, run: int) -> np.random.Generator:
    return np.random.default_rng([zlib.crc32(purpose.encode()), run])


def with_noise(made: SyntheticBlock, random: np.random.Generator) -> Block:
    """Return the block with normal errors as large as the a-priori errors on photo points and weighted control."""
    points = made.block.photo_points
    place = made.block.point_index()
    control = []
    for point in made.block.control_points:
        error = np.array(point.errors)
        control.append(
            replace(point, coordinates=tuple(made.points[place[point.name]] + error * random.normal(size=3)))
        )
    noisy = points.xy + points.error * random.normal(size=points.xy.shape)
    return replace(made.block, photo_points=replace(points, xy=noisy), control_points=tuple(control))


def started_off(block: Block, made: SyntheticBlock, relative: float, random: np.random.Generator) -> Block:
    """Return the block started off the truth by a part of the distance to the object, and as many radians."""
    points = block.photo_points
    offset = made.points[points.point] - made.orientations[points.photo, :3]
    distance = float(np.mean(np.linalg.norm(offset, axis=1)))
    scale = relative * np.repeat([distance, 1.0], 3)
    orientation = made.orientations + scale * random.normal(size=made.orientations.shape)
    start = made.points + relative * distance * random.normal(size=made.points.shape)
    return replace(
        block, photo_orientation=orientation, point_start=np.where(block.constant_points, made.points, start)
    )


def with_blunders(block: Block, redundancy_numbers: np.ndarray, random: np.random.Generator) -> Blundered:
    """Return the block with 1 to 5 % of the photo coordinates wrong by 10 to 60 standard deviations.

    Wrong are coordinates with a redundancy number of 0.3 and more, of each photo point one at the most.
    """
    points = block.photo_points
    wanted = max(1, round(random.uniform(0.01, 0.05) * points.xy.size))
    rows = random.permutation(np.flatnonzero(redundancy_numbers[: points.xy.size] >= 0.3))
    _, first = np.unique(rows // 2, return_index=True)
    rows = rows[np.sort(first)][:wanted]
    sizes = random.uniform(10.0, 60.0, len(rows)) * random.choice([-1.0, 1.0], len(rows))
    xy = points.xy.ravel().copy()
    xy[rows] += sizes * points.error.ravel()[rows]
    return Blundered(replace(block, photo_points=replace(points, xy=xy.reshape(-1, 2))), rows, sizes)


def in_parallel(function: Callable[[Item], Result], items: Iterable[Item], processes: int) -> list[Result]:
    """Return what a function of a module gives for each item; one process: no other is started."""
    if processes == 1:
        with threadpool_limits(1):
            return [function(item) for item in items]
    # fork would copy the threads' locks of this process
    pool = ProcessPoolExecutor(processes, get_context("spawn"), initializer=threadpool_limits, initargs=(1,))
    with pool:
        return list(pool.map(function, items, chunksize=10))
