"""Blocks as the other programs get them: control points as constants, pixels to the right and down, one file.

python peer_problem.py 500 problem.npz
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from aerial_blocks import FRAME_MM, NOISE_MM, POINTS_A_PHOTO, aerial_block
from bal import LADYBUG, bal_block
from bal_files import BAL_FILES, block_of_file
from wide_blocks import BLOCKS

from orip.bundle.starting_state import starting_state
from orip.records.block import Block
from orip.structs import replace

BAL = "BAL"
_PIXEL_MM = 2.0 * NOISE_MM
_IN_PIXELS = (BAL, *BAL_FILES)


def block_of(case: str, points_a_photo: int = POINTS_A_PHOTO) -> Block:
    """Return the block of a case: the BAL problem, a BAL text, a wide block, or an aerial one of so many photos."""
    if case == BAL:
        return bal_block(LADYBUG)
    if case in BAL_FILES:
        return block_of_file(case)
    return constant_control(BLOCKS[case]() if case in BLOCKS else aerial_block(int(case), points_a_photo))


def constant_control(block: Block) -> Block:
    """Return a block with its control points as constants, as COLMAP knows no weighted ones."""
    if not block.control_points:
        return block
    place = block.point_index()
    rows = [place[point.name] for point in block.control_points]
    start, constant = block.point_start.copy(), block.constant_points.copy()
    start[rows] = [point.coordinates for point in block.control_points]
    constant[rows] = True
    control = tuple(replace(point, errors=(0.0, 0.0, 0.0)) for point in block.control_points)
    return replace(block, point_start=start, constant_points=constant, control_points=control)


def pixel_mm(case: str) -> float:
    """Return the size of a pixel in the unit of the block's photo coordinates."""
    return 1.0 if case in _IN_PIXELS else _PIXEL_MM


def save_for_peer(case: str, path: Path) -> None:
    """Write the problem of a case as arrays.

    Cameras (k, 5) are f, the principal point and k1, k2 of f (1 + k1 r^2 + k2 r^4) with r at a distance of 1.
    """
    block, pixel = block_of(case), pixel_mm(case)
    state = starting_state(block)
    shown = 2.0 * np.abs(block.photo_points.xy).max(axis=0) + 2.0 if case in _IN_PIXELS else FRAME_MM
    width, height = (round(side / pixel) for side in shown)
    turned = np.diag([1.0, -1.0, -1.0]) @ np.swapaxes(state.rotations, 1, 2)
    c, a3, a5 = (state.cameras[:, place] for place in (0, 4, 5))
    middle = np.full(len(c), width / 2.0), np.full(len(c), height / 2.0)
    points = block.photo_points
    np.savez(
        path,
        size=[width, height],
        cameras=np.column_stack([c / pixel, *middle, a3 * c**2, a5 * c**4]),
        camera=block.photo_camera,
        principal_point_unknown="DX" in block.cameras[0].unknown,
        free=case in _IN_PIXELS or block.is_free_network,
        rotations=turned,
        translations=-np.einsum("nij,nj->ni", turned, state.centres),
        points=state.points,
        constant=np.flatnonzero(block.constant_points.all(axis=1)),
        photo=points.photo,
        point=points.point,
        pixels=points.xy / pixel * [1.0, -1.0] + [width / 2.0, height / 2.0],
    )


if __name__ == "__main__":
    save_for_peer(sys.argv[1], Path(sys.argv[2]))
