"""The routes by parts and by photos: placed on the ground together, by control."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import compress
from operator import attrgetter

import numpy as np
from msgspec import Struct

from orip.arrays import BoolArray, FloatArray, IntArray
from orip.prelim.block_grower import FITTING, BlockGrower
from orip.prelim.found_values import fits_by_chance, is_strong, rays_that_count, redundancy, robust_square_sum
from orip.prelim.growing_block import GrowingBlock, residual_lengths
from orip.prelim.joint_placing import Placement, annealed, levelling, place_parts, tilts
from orip.prelim.parts import (
    FLAT,
    LOOKING_DOWN,
    UPRIGHT,
    Ties,
    assembled_at,
    single_photo,
    supported_photos,
    ties_between,
)
from orip.prelim.relative.orientation import OrientedPair, pairs_by_common_points
from orip.prelim.routes import POINTS_FOR_A_PAIR, Route, worth_of_pair
from orip.records.preliminary import NotOriented, PartialBlock
from orip.structs import replace

# For blocks whose parts share too few points to be joined one after the other, or none of which sees enough control.

_POINTS = 3
"""Points that a part needs."""

_ROUNDS_OF_PARTS = 3
"""Number of adjustments of plan and height."""

_MOST_MODELS = 4
"""Models of a photo, the best ones, that are placed; more where they join what nothing else does."""


def by_parts(free: BlockGrower, held: BlockGrower, known: FloatArray, start: Route) -> Iterator[Route]:
    """Yield routes by all parts of a block together, levelled as if their photos looked down, or stood upright.

    The attitude in which the parts fit better is the first.

    Parameters
    ----------
    free, held : BlockGrower
        Without control, and with the control that holds the block.
    known : array (number of points, 3)
        Control, also that known in part; NaN where not known.
    start : Route
        By pairs: its systems are parts, beside models of photos that are in two of them.
    """
    rays = free.rays
    # the points of a system may all have turned out wrong
    parts = [part for part in (system.partial_block() for system in start.systems) if len(part.points) >= _POINTS]
    parts += _models_between(free, parts)
    supported = supported_photos(rays, known)
    alone = supported.copy()
    for part in parts:
        alone[part.photos] = False
    parts = [_with_single_rays(part, free) for part in parts]
    parts += [single_photo(rays, int(photo), free.index.rows[photo]) for photo in np.flatnonzero(alone)]
    how = f"placed on the ground together with all {len(parts)} parts of the block"
    for placement in _placements(parts, known):
        block = annealed(held, assembled_at(parts, placement.movements), supported, how)
        yield Route((held.grow(block),), on_ground=True, relative=start.relative)


def _placements(parts: Sequence[PartialBlock], known: FloatArray) -> list[Placement]:
    """Return where parts are on the ground, by the attitudes of their photos that are possible; the best first."""
    ties, found = ties_between(parts, known), []
    for axis in (LOOKING_DOWN, UPRIGHT):
        turns = [levelling(part, axis) for part in parts]
        level = [turn for turn in turns if turn is not None]
        placement = place_parts(ties, np.stack(level), _ROUNDS_OF_PARTS) if level and len(level) == len(turns) else None
        if placement is not None:
            found.append(placement)
    return sorted(found, key=attrgetter("misfit"))


def _models_between(grower: BlockGrower, parts: list[PartialBlock]) -> list[PartialBlock]:
    """Return models of photos that are in different parts, or in none: the best of each photo, and all that join."""
    part_of = np.full(len(grower.rays.photos), -1)
    for number, part in enumerate(parts):
        part_of[part.photos] = number
    found: list[OrientedPair] = []
    for left, right, _ in pairs_by_common_points(grower.common, POINTS_FOR_A_PAIR):
        if part_of[left] != part_of[right] or part_of[left] < 0:
            model = grower.model(left, right)
            if isinstance(model, NotOriented) or len(model.block.points) < _POINTS:
                continue
            if model.fitting >= FITTING:
                found.append(model)
    group = np.where(part_of < 0, len(parts) + np.arange(len(part_of)), part_of)
    photos = np.array([model.photos for model in found], dtype=np.int64).reshape(-1, 2)
    kept = best_models(photos, np.array([worth_of_pair(model) for model in found]), group)
    return [model.block for model in compress(found, kept)]


def best_models(photos: IntArray, worths: FloatArray, group: IntArray) -> BoolArray:
    """Return which models (n,) are among the best of one of their photos, or join what no better one does.

    A point that twenty photos show is in 190 models of theirs, and would tie each of these to each other one.

    Parameters
    ----------
    photos : array (n, 2) of int
    worths : array (n,)
        How good the models are.
    group : array (number of photos,) of int
        Photos of one group are joined already.
    """
    kept, group, models = np.zeros(len(photos), dtype=bool), group.copy(), np.zeros(len(group), dtype=np.int64)
    for place in np.argsort(-worths, kind="stable").tolist():
        pair = photos[place]
        one, other = group[pair].tolist()
        if one != other or models[pair].min() < _MOST_MODELS:
            kept[place] = True
            models[pair] += 1
            group[group == other] = one
    return kept


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
        deviations.append(np.full((len(new), 3), FLAT * depth))
        has[rays.point[new]] = True
    return replace(
        part,
        points=np.concatenate(points),
        coordinates=np.concatenate(coordinates),
        deviations=np.concatenate(deviations),
    )


# It needs neither pairs of photos with common points enough for a model nor known points for a resection. Where the
# first attitudes lead to another minimum, others are tried (random multi-start); not where the redundancy is large,
# since the other routes then lead to the block if anything does.

_TILTS = (0.1, 0.3)
"""Standard deviations of the slopes of photos that are tried, in turns."""

_PHOTOS_PLACED = 1200
"""Number of starts times number of photos."""

_MOST_STARTS = 120

_ROUNDS_OF_PHOTOS = 1
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
    placements = [place_parts(photos.ties, turns, _ROUNDS_OF_PHOTOS) for turns in photos.level]
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
        placement = place_parts(photos.ties, turns, _ROUNDS_OF_PHOTOS)
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
