"""The route by parts: parts made of pairs of photos are placed on the ground together, by control and common points.

For blocks whose parts share too few points to be joined one after the other, or none of which sees enough control.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from operator import attrgetter

import numpy as np

from orip.arrays import FloatArray
from orip.prelim.growing.block_grower import FITTING, BlockGrower
from orip.prelim.joint.annealing import annealed
from orip.prelim.joint.placing import Placement, levelling, place_parts
from orip.prelim.joint.single_photos import FLAT, LOOKING_DOWN, UPRIGHT, single_photo, supported_photos
from orip.prelim.joint.ties import assembled_at, ties_between
from orip.prelim.relative.pair_selection import pairs_by_common_points
from orip.prelim.routes import POINTS_FOR_A_PAIR, Route
from orip.records.results.preliminary import NotOriented, PartialBlock
from orip.structs import replace

_POINTS = 3
"""Points that a part needs."""

_ROUNDS = 3
"""Number of adjustments of plan and height."""


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
        placement = place_parts(ties, np.stack(level), _ROUNDS) if level and len(level) == len(turns) else None
        if placement is not None:
            found.append(placement)
    return sorted(found, key=attrgetter("misfit"))


def _models_between(grower: BlockGrower, parts: list[PartialBlock]) -> Iterator[PartialBlock]:
    """Yield the models of photos that are in different parts, or in none."""
    part_of = np.full(len(grower.rays.photos), -1)
    for number, part in enumerate(parts):
        part_of[part.photos] = number
    for left, right, _ in pairs_by_common_points(grower.common, POINTS_FOR_A_PAIR):
        if part_of[left] != part_of[right] or part_of[left] < 0:
            model = grower.model(left, right)
            if isinstance(model, NotOriented) or len(model.block.points) < _POINTS:
                continue
            if model.fitting >= FITTING:
                yield model.block


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
