"""The route by photos: all photos of a block are placed on the ground together, one by one, their points in a plane.

It needs neither pairs of photos with common points enough for a model nor known points for a resection. Where the first
attitudes lead to another minimum, others are tried (random multi-start); not where the redundancy is large, since the
other routes then lead to the block if anything does.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from orip.arrays import FloatArray
from orip.prelim.fit import fits_by_chance, is_strong, rays_that_count, redundancy, robust_square_sum
from orip.prelim.growing.block_grower import BlockGrower
from orip.prelim.growing.misplaced_photos import residual_lengths
from orip.prelim.joint.annealing import placed_together
from orip.prelim.joint.placing import levelled, tilted
from orip.prelim.joint.single_photos import LOOKING_DOWN, UPRIGHT, single_photo, supported_photos
from orip.prelim.routes import Route
from orip.records.results.preliminary import PartialBlock

_TILTS = (0.1, 0.3)
"""Standard deviations of the slopes of photos that are tried, in turns."""

_PHOTOS_PLACED = 1200
"""Number of starts times number of photos."""

_MOST_STARTS = 120


def by_photos(held: BlockGrower, known: FloatArray) -> Route:
    """Go by all photos of a block together, in the attitude that fits best of those that are tried.

    Parameters
    ----------
    held : BlockGrower
        With the control that holds the block.
    known : array (number of points, 3)
        Control, also that known in part; NaN where not known.
    """
    rays = held.rays
    supported = supported_photos(rays, known)
    photos = [single_photo(rays, int(photo), held.index.rows[photo]) for photo in np.flatnonzero(supported)]
    degrees = redundancy(rays, held.held_points, rays_that_count(rays, supported, held.held_points))
    at_random = 0 if is_strong(degrees, len(photos)) else min(_MOST_STARTS, _PHOTOS_PLACED // max(len(photos), 1))
    how = f"placed on the ground together with all {len(photos)} photos of the block"
    best, least = None, np.inf
    for parts in _attitudes(photos, at_random):
        block = placed_together(held, parts, known, supported, how)
        if block is None:
            continue
        square_sum = robust_square_sum(residual_lengths(held.seen(block), block))
        if square_sum < least:
            best, least = block, square_sum
        if fits_by_chance(least, degrees):
            break
    return Route(()) if best is None else Route((held.grow(best),), on_ground=True)


def _attitudes(photos: list[PartialBlock], at_random: int) -> Iterator[list[PartialBlock]]:
    """Yield the photos looking down, upright, then tilted at random from these attitudes."""
    if not photos:
        return
    level = [[turned for photo in photos if (turned := levelled(photo, axis))] for axis in (LOOKING_DOWN, UPRIGHT)]
    yield from level
    random = np.random.default_rng(0)
    for start in range(at_random):
        slopes = _TILTS[start // 2 % 2] * random.normal(size=(len(photos), 2))
        yield [tilted(photo, *slope) for photo, slope in zip(level[start % 2], slopes, strict=True)]
