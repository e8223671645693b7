"""Seeded blocks as texts of Bundle Adjustment in the Large, with what blocks of other programs have and ours lack.

    python benchmarks/bal_files.py penta-bal penta.txt

Of the rays of an aerial, a penta and a ring block a part is missing at random, as where matching fails; photos and
points come in no order; one camera with C, A3 and A5 unknown has pixels in the place of millimetres, and no principal
point; there is no control, and the start is off by some thousandths of the distance.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
from aerial_blocks import NOISE_MM, TRUE_CAMERA, aerial_block
from bal import bal_block
from scipy.spatial.transform import Rotation
from wide_blocks import penta_block, rings_block

from orip.records.block import Block
from orip.structs import replace

PIXEL_MM = 2.0 * NOISE_MM
_MADE: dict[str, tuple[Callable[[], Block], float]] = {
    "aerial-bal": (partial(aerial_block, 500), 0.9),
    "aerial-bal-2000": (partial(aerial_block, 2000), 0.9),
    "penta-bal": (penta_block, 0.6),
    "rings-bal": (rings_block, 0.6),
}
"""The blocks, and the share of the rays that is left of each."""
BAL_FILES = tuple(_MADE)
_OFF = 0.003
"""Of the distance between photo and points: how far both start from where they should be."""


def bal_text(case: str) -> str:
    """Return the text of a block; the same at every call."""
    make, share = _MADE[case]
    block = make()
    random = np.random.default_rng(len(block.photos))
    rays = block.photo_points
    left = random.random(len(rays.photo)) < share
    often = np.bincount(rays.point[left], minlength=len(block.point_names)) >= 2
    left &= often[rays.point]
    new_photo, new_point = random.permutation(len(block.photos)), random.permutation(np.flatnonzero(often))
    photo_number = np.argsort(new_photo)
    point_number = np.full(len(often), -1)
    point_number[new_point] = np.arange(len(new_point))
    photo, point = photo_number[rays.photo[left]], point_number[rays.point[left]]
    pixels = (rays.xy[left] - TRUE_CAMERA[1:3]) / PIXEL_MM
    order = np.lexsort((photo, point))
    cameras, ground = _started(block, random)
    head = f"{len(block.photos)} {len(new_point)} {len(order)}"
    observed = (f"{photo[k]} {point[k]} {x!r} {y!r}" for k, (x, y) in zip(order, pixels[order].tolist(), strict=True))
    numbers = map(repr, np.concatenate([cameras[new_photo].ravel(), ground[new_point].ravel()]).tolist())
    return "\n".join([head, *observed, *numbers]) + "\n"


def _started(block: Block, random: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Return cameras (p, 9) and points (n, 3) from where the adjustment starts."""
    centres, ground = block.photo_orientation[:, :3], block.point_start
    off = _OFF * np.median(np.linalg.norm(ground[:500] - np.median(centres, axis=0), axis=1))
    rotations = Rotation.from_euler("XYZ", block.photo_orientation[:, 3:])
    turned = Rotation.from_rotvec(0.5 * _OFF * random.normal(size=centres.shape)) * rotations.inv()
    moved = centres + off * random.normal(size=centres.shape)
    c, a3, a5 = TRUE_CAMERA[[0, 4, 5]]
    lens = np.tile([c / PIXEL_MM * (1.0 + _OFF), a3 * c**2, a5 * c**4], (len(centres), 1))
    cameras = np.hstack([turned.as_rotvec(), -turned.apply(moved), lens])
    return cameras, ground + off * random.normal(size=ground.shape)


def block_of_file(case: str) -> Block:
    """Return the block of a text, with one camera for all photos."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"{case}.txt"
        path.write_text(bal_text(case), encoding="ascii")
        block = bal_block(path)
    camera = replace(block.cameras[0], name="C")
    photos = tuple(replace(photo, camera="C") for photo in block.photos)
    return replace(block, cameras=(camera,), photos=photos, photo_camera=np.zeros(len(photos), dtype=np.int64))


if __name__ == "__main__":
    Path(sys.argv[2]).write_text(bal_text(sys.argv[1]), encoding="ascii")
