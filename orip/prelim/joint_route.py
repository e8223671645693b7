"""The route by parts: parts made of pairs of photos are placed on the ground together, by control and common points.

For blocks whose parts share too few points to be joined one after the other, or see too little control each.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from orip.arrays import BoolArray, FloatArray, IntArray
from orip.prelim.growing import FITTING, BlockGrower
from orip.prelim.growing_block import GrowingBlock, growing_block_of
from orip.prelim.image_rays import ImageRays
from orip.prelim.misplaced_photos import residual_lengths
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
"""Deviation of the depth of points in a single photo, which are assumed to lie in a plane, as a part of that depth."""

_NARROWER = 10.0
"""Ratio of the limits for blunders from one adjustment to the next."""

_POINTS = 3
"""Points that a part needs."""

_EQUATIONS = 6
"""Equations that a photo needs, which has as many unknowns."""


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
    start, rays = by_pairs(free, 0), free.rays
    # the points of a system may all have turned out wrong
    parts = [part for part in (system.partial_block() for system in start.systems) if len(part.points) >= _POINTS]
    parts += _models_between(free, parts)
    supported = _supported_photos(rays, np.asarray(np.isfinite(known).any(axis=1)))
    alone = supported.copy()
    for part in parts:
        alone[part.photos] = False
    parts = [_with_single_rays(part, free) for part in parts]
    parts += [_single_photo(rays, int(photo), free.index.rows[photo]) for photo in np.flatnonzero(alone)]
    placed = place_parts(parts, known, axis)
    if placed is None:
        return Route(())
    block = _started(held, assembled(placed), len(parts)).without_photos(~supported)
    return Route((held.grow(_refined_with_all_ties(held, block)),), on_ground=True, relative=start.relative)


def _refined_with_all_ties(held: BlockGrower, start: GrowingBlock) -> GrowingBlock:
    """Return a block after adjustments, in the first of which no ray counts as a blunder.

    Parts fit in themselves, so that the few points that tie them would lose their weight while the parts are still out
    of place (graduated non-convexity, Blake and Zisserman 1987).
    """
    lengths = residual_lengths(held.seen(start), start)
    finite = lengths[np.isfinite(lengths)]
    factor = float(finite.max(initial=0.0))
    while factor > 1.0:
        rays = replace(held.rays, error=factor * held.rays.error)
        start = replace(held, rays=rays).refined(start, 0.0)
        factor /= _NARROWER
    return held.refined(start, 0.0)


def _models_between(grower: BlockGrower, parts: list[PartialBlock]) -> Iterator[PartialBlock]:
    """Yield the models of photos that are in different parts, or in none."""
    part_of = np.full(len(grower.rays.photos), -1)
    for number, part in enumerate(parts):
        part_of[part.photos] = number
    for left, right, _ in pairs_by_common_points(grower.common, POINTS_FOR_A_PAIR):
        if part_of[left] != part_of[right] or part_of[left] < 0:
            model = grower.model(left, right)
            if not isinstance(model, RelativeOrientation) or len(model.block.points) < _POINTS:
                continue
            if np.mean(model.weight_factor >= 1.0) >= FITTING:
                yield model.block


def _supported_photos(rays: ImageRays, control: BoolArray) -> BoolArray:
    """Return which photos (number of photos,) may be determined: other photos and control give them enough equations.

    A point gives two if it is control or in two other photos, one if it is in one other photo.
    """
    supported = np.ones(len(rays.photos), dtype=bool)
    while True:
        used = supported[rays.photo]
        others = np.bincount(rays.point[used], minlength=len(rays.points))[rays.point] - 1
        equations = np.where(control[rays.point], 2, np.clip(others, 0, 2))
        enough = np.bincount(rays.photo, weights=equations * used, minlength=len(supported)) >= _EQUATIONS
        if not (supported & ~enough).any():
            return supported
        supported &= enough


def _with_single_rays(part: PartialBlock, grower: BlockGrower) -> PartialBlock:
    """Return a part with the points that are in one of its photos, at the median depth of that photo's other points."""
    rays = grower.rays
    points, coordinates, deviations = [part.points], [part.coordinates], [part.deviations]
    place = np.full(len(rays.points), -1)
    place[part.points] = np.arange(len(part.points))
    has = place >= 0
    for photo, rotation, centre in zip(part.photos, part.rotations, part.centres, strict=True):
        rows = grower.index.rows[photo]
        at = place[rays.point[rows]]
        mine = part.coordinates[at[at >= 0]]
        new = rows[~has[rays.point[rows]]]
        if not len(mine) or not len(new):
            continue
        depth = float(np.median((centre - mine) @ rotation[:, 2]))
        vectors = rays.vectors[new]
        points.append(rays.point[new])
        coordinates.append(centre + (depth / -vectors[:, 2:] * vectors) @ rotation.T)
        deviations.append(np.full((len(new), 3), _FLAT * depth))
        has[rays.point[new]] = True
    return replace(
        part,
        points=np.concatenate(points),
        coordinates=np.concatenate(coordinates),
        deviations=np.concatenate(deviations),
    )


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
    how = f"placed on the ground together with all {parts} parts of the block"
    start = growing_block_of(held.rays, block, how)
    return replace(start, coordinates=np.where(held.held_points[:, None], held.held, start.coordinates))
