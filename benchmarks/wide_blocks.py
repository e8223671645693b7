"""Seeded blocks whose photos make no narrow band: five cameras looking five ways, and closed rings around an object.

    OPENBLAS_NUM_THREADS=1 python benchmarks/wide_blocks.py penta rings

A *penta* block of 400 photos has 80 exposure stations with a vertical photo and four oblique ones; a point is measured
in 32 photos on average. *rings* has 500 photos of a tower, taken from three closed rings around it, 33 rays a point and
no control: a free network. In both the photos come in random order, and all points are in different photos. Times are
CPU seconds.
"""

from __future__ import annotations

import resource
import sys
from collections.abc import Callable

import numpy as np
from aerial_blocks import FRAME_MM, TRUE_CAMERA, measured, seeded_block
from scipy.spatial.transform import Rotation

from orip.records.block import Block

PENTA_PHOTOS, PENTA_POINTS = 400, 12_100
RING_PHOTOS, RING_POINTS = 500, 23_500


def penta_block(photos: int = PENTA_PHOTOS, points: int = PENTA_POINTS) -> Block:
    """Return a block of five photos at every exposure station, with control; the same at every call."""
    random = np.random.default_rng([5, photos, points])
    stations = photos // 5
    along = round(np.sqrt(stations))
    number = np.arange(stations)
    place = np.column_stack([262.0 * (number % along), 302.0 * (number // along), np.full(stations, 1000.0)])
    centres = np.repeat(place + 5.0 * random.normal(size=place.shape), 5, axis=0)
    # down, forwards, backwards, left, right
    tilts = np.radians([[0.0, 0.0], [45.0, 0.0], [-45.0, 0.0], [0.0, 45.0], [0.0, -45.0]])
    angles = np.zeros((len(centres), 3))
    angles[:, :2] = np.tile(tilts, (stations, 1))
    angles += np.radians([1.0, 1.0, 2.0]) * random.normal(size=angles.shape)
    low, high = place[:, :2].min(axis=0) - 700.0, place[:, :2].max(axis=0) + 700.0
    plan = random.uniform(low, high, size=(points, 2))
    height = 40.0 * np.sin(plan[:, 0] / 400.0) * np.cos(plan[:, 1] / 300.0) + random.normal(size=points)
    orientations = random.permutation(np.hstack([centres, angles]))
    return _seen(
        random, orientations, np.column_stack([plan, height]), np.ones((points, len(orientations)), dtype=bool), 30
    )


def rings_block(photos: int = RING_PHOTOS, points: int = RING_POINTS) -> Block:
    """Return a free network of photos from three rings around a tower of 100 m; the same at every call."""
    random = np.random.default_rng([3, photos, points])
    number = np.arange(photos)
    azimuth = 2.0 * np.pi * (number // 3) / (photos / 3.0) + 0.1 * (number % 3)
    outwards = np.column_stack([np.cos(azimuth), np.sin(azimuth), np.zeros(photos)])
    centres = (
        134.0 * outwards + [0.0, 0.0, 1.0] * (15.0 + 35.0 * (number % 3))[:, None] + random.normal(size=(photos, 3))
    )
    side = 2.0 * np.pi * random.uniform(size=points)
    normal = np.column_stack([np.cos(side), np.sin(side), np.zeros(points)])
    ground = (60.0 + random.normal(size=points))[:, None] * normal + [0.0, 0.0, 1.0] * random.uniform(
        0.0, 100.0, points
    )[:, None]
    # the axes of a photo: along the ring, upwards, and away from the tower
    axes = np.stack([np.cross([0.0, 0.0, 1.0], outwards), np.tile([0.0, 0.0, 1.0], (photos, 1)), outwards], axis=2)
    turned = Rotation.from_rotvec(np.radians(1.0) * random.normal(size=(photos, 3))) * Rotation.from_matrix(axes)
    orientations = random.permutation(np.hstack([centres, turned.as_euler("XYZ")]))
    faces = np.einsum("pi,ni->pn", normal, orientations[:, :2] @ np.eye(2, 3) / 134.0) > 0.7
    return _seen(random, orientations, ground, faces, 0)


def _seen(
    random: np.random.Generator, orientations: np.ndarray, ground: np.ndarray, faces: np.ndarray, control: int
) -> Block:
    """Return the block of the points that photos show from the side that they face."""
    point, photo = np.nonzero(faces)
    rotation = Rotation.from_euler("XYZ", orientations[:, 3:]).as_matrix()
    u = np.einsum("nji,nj->ni", rotation[photo], ground[point] - orientations[photo, :3])
    ideal = -TRUE_CAMERA[0] * u[:, :2] / u[:, 2:]
    r2 = np.sum(ideal**2, axis=1, keepdims=True)
    xy = TRUE_CAMERA[1:3] + ideal * (1.0 + r2 * (TRUE_CAMERA[4] + r2 * TRUE_CAMERA[5]))
    shown = (u[:, 2] < 0.0) & (np.abs(xy) < np.array(FRAME_MM) / 2.0).all(axis=1)
    photo, point, xy = photo[shown], point[shown], xy[shown]
    often = np.bincount(point, minlength=len(ground))[point] >= 3
    return seeded_block(random, orientations, ground, photo[often], point[often], xy[often], control)


BLOCKS: dict[str, Callable[[], Block]] = {"penta": penta_block, "rings": rings_block}


def main() -> None:
    """Adjust the blocks that are named and print what they took."""
    print("block  photos   points  photo points  iterations  s/iteration  s/minimum  s/precision  MB peak     sigma0")
    for name in sys.argv[1:] or list(BLOCKS):
        block = BLOCKS[name]()
        solved, times, precision = measured(block)
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
        size = f"{len(block.photos):7d} {len(block.point_names):8d} {len(block.photo_points.photo):13d}"
        print(
            f"{name:5s} {size} {len(times):11d} {min(times):12.3f} {sum(times):10.3f} {precision:12.3f} {peak:8.0f} "
            f"{solved.variance.sigma0:10.6f}",
            flush=True,
        )


if __name__ == "__main__":
    main()
