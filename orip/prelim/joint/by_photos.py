"""The route by photos: all photos of a block are placed on the ground together, one by one, their points in a plane.

It needs neither pairs of photos with common points enough for a model nor known points for a resection. Where the first
attitudes lead to another minimum, others are tried (random multi-start); not where the redundancy is large, since the
other routes then lead to the block if anything does.
"""

from __future__ import annotations

from collections.abc import Iterator
from operator import attrgetter

import numpy as np
from msgspec import Struct

from orip.arrays import BoolArray, FloatArray
from orip.prelim.fit import fits_by_chance, is_strong, rays_that_count, redundancy, robust_square_sum
from orip.prelim.growing.block_grower import BlockGrower
from orip.prelim.growing.growing_block import GrowingBlock
from orip.prelim.growing.misplaced_photos import residual_lengths
from orip.prelim.joint.annealing import annealed
from orip.prelim.joint.placing import Placement, levelling, place_parts, tilts
from orip.prelim.joint.single_photos import LOOKING_DOWN, UPRIGHT, single_photo, supported_photos
from orip.prelim.joint.ties import Ties, assembled_at, ties_between
from orip.prelim.routes import Route
from orip.records.results.preliminary import PartialBlock

_TILTS = (0.1, 0.3)
"""Standard deviations of the slopes of photos that are tried, in turns."""

_PHOTOS_PLACED = 1200
"""Number of starts times number of photos."""

_MOST_STARTS = 120

_ROUNDS = 1
"""Number of adjustments of plan and height: points in a plane do not tell how a photo is tilted."""


def by_level_photos(held: BlockGrower, known: FloatArray) -> Route:
    """Go by all photos of a block together, as if they looked down or stood upright, if they fit their rays then.

    Parameters
    ----------
    held : BlockGrower
        With the control that holds the block.
    known : array (number of points, 3)
        Control, also that known in part; NaN where not known.
    """
    photos = _photos(held, known)
    placements = [place_parts(photos.ties, turns, _ROUNDS) for turns in photos.level]
    for placement in sorted(filter(None, placements), key=attrgetter("misfit")):
        block, square_sum = photos.adjusted(held, placement)
        if fits_by_chance(square_sum, photos.degrees):
            return photos.route(held, block)
    return Route(())


def by_photos(held: BlockGrower, known: FloatArray) -> Route:
    """Go by all photos of a block together, in the attitude that fits best of those that are tried.

    Parameters
    ----------
    held : BlockGrower
        With the control that holds the block.
    known : array (number of points, 3)
        Control, also that known in part; NaN where not known.
    """
    photos = _photos(held, known)
    best, least = None, np.inf
    for turns in photos.attitudes():
        placement = place_parts(photos.ties, turns, _ROUNDS)
        if placement is None:
            continue
        block, square_sum = photos.adjusted(held, placement)
        if square_sum < least:
            best, least = block, square_sum
        if fits_by_chance(least, photos.degrees):
            break
    return Route(()) if best is None else photos.route(held, best)


class _Photos(Struct, frozen=True):
    """The photos of a block as parts of their own.

    Parameters
    ----------
    parts : list of PartialBlock
        Of the supported photos.
    supported : array (number of photos,) of bool
    ties : Ties
    degrees : int
        Redundancy of the block.
    level : list of arrays (parts, 3, 3)
        Rotations after which the photos look down, and stand upright; none without photos.
    """

    parts: list[PartialBlock]
    supported: BoolArray
    ties: Ties
    degrees: int
    level: list[FloatArray]

    def attitudes(self) -> Iterator[FloatArray]:
        """Yield rotations (parts, 3, 3): photos looking down, upright, then tilted at random from these attitudes."""
        yield from self.level
        if not self.parts or is_strong(self.degrees, len(self.parts)):
            return
        random = np.random.default_rng(0)
        for start in range(min(_MOST_STARTS, _PHOTOS_PLACED // len(self.parts))):
            slopes = _TILTS[start // 2 % 2] * random.normal(size=(len(self.parts), 2))
            yield tilts(slopes) @ self.level[start % 2]

    def adjusted(self, held: BlockGrower, placement: Placement) -> tuple[GrowingBlock, float]:
        """Return the block adjusted from a placement, and its robust square sum."""
        how = f"placed on the ground together with all {len(self.parts)} photos of the block"
        placed = assembled_at(self.parts, placement.movements)
        block = held.refined(annealed(held, placed, self.supported, how), 0.0)
        return block, robust_square_sum(residual_lengths(held.seen(block), block))

    def route(self, held: BlockGrower, block: GrowingBlock) -> Route:
        """Return the route to a block, to which the other photos are added."""
        return Route((block if self.supported.all() else held.grow(block),), on_ground=True)


def _photos(held: BlockGrower, known: FloatArray) -> _Photos:
    rays = held.rays
    supported = supported_photos(rays, known)
    parts = [single_photo(rays, int(photo), held.index.rows[photo]) for photo in np.flatnonzero(supported)]
    degrees = redundancy(rays, held.held_points, rays_that_count(rays, supported, held.held_points))
    level = [levelling(parts[0], axis) for axis in (LOOKING_DOWN, UPRIGHT) if parts]
    turns = [np.broadcast_to(turn, (len(parts), 3, 3)) for turn in level if turn is not None]
    return _Photos(parts, supported, ties_between(parts, known), degrees, turns)
