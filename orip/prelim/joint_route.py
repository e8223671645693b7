"""The route by parts: what pairs of photos connect is placed on the ground together, by control and all common points.

For blocks whose parts share too few points to be joined one after the other, or see too little control each.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from orip.arrays import FloatArray, IntArray
from orip.prelim.growing import FITTING, BlockGrower
from orip.prelim.growing_block import GrowingBlock, growing_block_of
from orip.prelim.image_rays import ImageRays
from orip.prelim.relative.pair_selection import pairs_by_common_points
from orip.prelim.routes import POINTS_FOR_A_PAIR, Route, by_pairs
from orip.prelim.similarity.levelled_parts import place_parts
from orip.prelim.similarity.partial_blocks import assembled
from orip.records.preliminary import PartialBlock, RelativeOrientation

LOOKING_DOWN, UPRIGHT = 2, 1
"""Axes of the photos that may point up."""

_M = 1e-3
"""Parts are in metres at photo scale."""

_FLAT = 0.1
"""Deviation of the depth of points in a single photo, which are taken to lie in a plane, as part of that depth."""


def by_parts(free: BlockGrower, held: BlockGrower, known: FloatArray, axis: int) -> Route:
    """Go by all parts of a block together, which are levelled by the attitude of their photos.

    Parameters
    ----------
    free, held : BlockGrower
        Without control, and with the control that holds the block.
    known : array (number of points, 3)
        Control, also that known in part; NaN where not known.
    axis : {LOOKING_DOWN, UPRIGHT}
        How the photos were taken.
    """
    start = by_pairs(free, 0)
    parts = [system.partial_block() for system in start.systems]
    parts += _models_between(free, parts)
    placed_photos = np.concatenate([part.photos for part in parts]) if parts else np.zeros(0, dtype=np.int64)
    alone = np.setdiff1d(np.unique(free.rays.photo), placed_photos)
    parts += [_single_photo(free.rays, int(photo), free.index.rows[photo]) for photo in alone]
    placed = place_parts(parts, known, axis)
    if placed is None:
        return Route(())
    grown = held.grow(held.refined(_started(held, assembled(placed), len(parts)), 0.0))
    return Route((grown,), on_ground=True, relative=start.relative)


def _models_between(grower: BlockGrower, parts: list[PartialBlock]) -> Iterator[PartialBlock]:
    """Yield the models of photos that are in different parts, or in none."""
    part_of = np.full(len(grower.rays.photos), -1)
    for number, part in enumerate(parts):
        part_of[part.photos] = number
    for left, right, _ in pairs_by_common_points(grower.common, POINTS_FOR_A_PAIR):
        if part_of[left] != part_of[right] or part_of[left] < 0:
            model = grower.model(left, right)
            if isinstance(model, RelativeOrientation) and np.mean(model.weight_factor >= 1.0) >= FITTING:
                yield model.block


def _single_photo(rays: ImageRays, photo: int, rows: IntArray) -> PartialBlock:
    """Return a photo as a part of its own, its points in a plane."""
    coordinates = _M * rays.vectors[rows]
    return PartialBlock(
        rays.photos[photo],
        np.array([photo]),
        np.eye(3)[None],
        np.zeros((1, 3)),
        rays.point[rows],
        coordinates,
        np.abs(_FLAT * coordinates[:, [2, 2, 2]]),
    )


def _started(held: BlockGrower, block: PartialBlock, parts: int) -> GrowingBlock:
    how = f"placed on the ground with all {parts} parts of the block together"
    start = growing_block_of(held.rays, block, how)
    return replace(start, coordinates=np.where(held.held_points[:, None], held.held, start.coordinates))
