"""Blocks of which nothing is known on the ground."""

from __future__ import annotations

import numpy as np
from bundle.aerial_block import aerial_block
from bundle.solving import noisy, with_photo_points, with_rays
from support.synthetic_block import SyntheticBlock

from orip.records.block import Block
from orip.records.results.solution import Solution
from orip.structs import replace

MADE = aerial_block("no control", 6)


def from_nothing(made: SyntheticBlock, seed: int = 1) -> Block:
    """Return the block with photo errors, but without control and orientations."""
    block = noisy(made, seed)
    unknown = np.full_like(block.photo_orientation, np.nan)
    photos = tuple(replace(photo, orientation=(None,) * 6) for photo in block.photos)
    points = np.full_like(block.point_start, np.nan)
    return replace(block, control_points=(), photo_orientation=unknown, photos=photos, point_start=points)


def off_truth(made: SyntheticBlock, found: Solution) -> float:
    """Return the largest difference of points from the truth, in standard deviations."""
    place = {name: row for row, name in enumerate(made.block.point_names)}
    truth = made.points[[place[name] for name in found.points.names]]
    return float(np.abs((found.points.values - truth) / found.points.sd).max())


def first_model() -> tuple[SyntheticBlock, Block]:
    """Return two photos with six common points and nothing else, as the first model of OLTRIS' Simplon block."""
    points = MADE.block.photo_points
    both = np.intersect1d(points.point[points.photo == 0], points.point[points.photo == 1])
    chosen = both[np.linspace(0, len(both) - 1, 6).astype(int)]
    block = with_photo_points(MADE.block, (points.photo < 2) & np.isin(points.point, chosen))
    made = with_rays(replace(MADE, block=block), 2)
    block = from_nothing(made)
    return made, replace(
        block,
        photos=block.photos[:2],
        photo_camera=block.photo_camera[:2],
        photo_orientation=block.photo_orientation[:2],
    )
