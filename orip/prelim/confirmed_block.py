"""A block without the photo points that others contradict, and the rays that its grown parts confirm."""

from __future__ import annotations

import math

import numpy as np

from orip.adjustment.weights import LIMIT_OF_TWO_COMPONENTS
from orip.arrays import BoolArray, IntArray
from orip.geometry.rays import PhotoRays
from orip.prelim.confirmed_rays import RayComparison, Votes, compared_pairs
from orip.prelim.growing_block import GrowingBlock
from orip.prelim.measured_block import MORE, MeasuredBlock
from orip.prelim.rays import ImageRays, intersect, rays_of_plane_images, thinned, with_consensus
from orip.prelim.relative.orientation import OrientedPair
from orip.prelim.routes import by_pairs
from orip.structs import replace

_POINTS_OF_TRACKS = 15
"""Points of the median photo from which so many points are common to three photos that wrong ones show."""

_MANY = 0.03
"""Part of the rays that others contradict from which the block is one of tracks."""

_PAIRS_LOOKED_AT, _MANY_MISS = 3, 0.14
"""Pairs of photos spread over a block, and the part of their rays that miss each other from which the block may be one
of tracks: an ordinary one, with twenty photo points in a hundred wrong in no more than a few photos, has less."""

_DECIDED = 3.0
"""Standard deviations from that limit at which it is decided, wrongly in one of 700 blocks that are just at it."""

_PHOTOS_COMPARED = 3
"""Photos by which a ray is confirmed, itself included."""

_LEAST_RAYS = 2
"""Rays of a control point; where fewer are left all stay, as it is not known which of them are right."""


_PASSES = 3
"""How often rays are compared: where fewer of the others are wrong, more is told of each."""

_ENOUGH = 80
"""Points of a photo that are compared."""


def has_many_misses(measured: MeasuredBlock) -> bool:
    """Tell whether many rays of a few pairs of photos miss each other: a block that grows from them all will not do.

    Pairs that cannot be oriented count with all their points. The models are those with which the block grows.
    """
    if not _can_be_compared(measured):
        return False
    pairs, grower = list(compared_pairs(measured.common)), measured.grower()
    points, misses = 0, 0.0
    for left, right in pairs[:: max(len(pairs) // _PAIRS_LOOKED_AT, 1)][:_PAIRS_LOOKED_AT]:
        model, number = grower.model(left, right), int(measured.common[left, right])
        fitting = model.fitting if isinstance(model, OrientedPair) else 0.0
        points, misses = points + number, misses + (1.0 - fitting) * number
    return misses > _MANY_MISS * points


def _can_be_compared(measured: MeasuredBlock) -> bool:
    per_photo = np.bincount(measured.rays.photo, minlength=len(measured.rays.photos))
    return bool(len(per_photo) >= _PHOTOS_COMPARED and np.median(per_photo) >= _POINTS_OF_TRACKS)


def confirmed_block(measured: MeasuredBlock) -> MeasuredBlock | None:
    """Return the block without the rays that others contradict; None where these are few.

    Rays that could not be compared stay, and so do those of control of which too few would be left.
    """
    if not _can_be_compared(measured):
        return None
    rays = _rays_to_compare(measured)
    comparison = RayComparison(rays)
    return _without_contradicted(measured, rays, comparison) if _many_contradicted(rays, comparison) else None


def block_without_contradicted_rays(measured: MeasuredBlock) -> MeasuredBlock | None:
    """Return the block without the rays that others contradict, however few these are; None where there are none."""
    if not _can_be_compared(measured):
        return None
    rays = _rays_to_compare(measured)
    kept = _without_contradicted(measured, rays, RayComparison(rays))
    return None if kept.confirmed.all() else kept


def _rays_to_compare(measured: MeasuredBlock) -> ImageRays:
    all_rays = measured.all_rays
    return thinned(rays_of_plane_images(measured.block, all_rays), _of_control(measured), _ENOUGH)


def _of_control(measured: MeasuredBlock) -> BoolArray:
    names = set(measured.control.names)
    return np.array([name in names for name in measured.all_rays.points], dtype=bool)


def _without_contradicted(measured: MeasuredBlock, rays: ImageRays, comparison: RayComparison) -> MeasuredBlock:
    all_rays, control = measured.all_rays, _of_control(measured)
    refused = rays.of(_contradicted(rays, comparison))
    place = {name: row for row, name in enumerate(all_rays.points)}
    place_of = np.array([place[name] for name in rays.points], dtype=np.int64)
    count = len(all_rays.points)
    kept = ~np.isin(all_rays.photo * count + all_rays.point, refused.photo * count + place_of[refused.point])
    left = np.bincount(all_rays.point[kept], minlength=len(control))
    kept |= (control & (left < _LEAST_RAYS))[all_rays.point]
    return measured.with_rays(kept)


def _many_contradicted(rays: ImageRays, comparison: RayComparison) -> bool:
    """Tell whether more than `_MANY` of the rays are contradicted, from as few of them as decide it.

    Sequential test (Wald 1945): pairs are compared until the part is as far from the limit as is unlikely by chance.
    """
    excess = 0.0
    for votes in comparison.votes_so_far():
        excess, deviation = excess_of_contradicted(rays, votes)
        if abs(excess) > _DECIDED * deviation:
            break
    return excess > 0.0


def excess_of_contradicted(rays: ImageRays, votes: Votes) -> tuple[float, float]:
    """Return by how much the part of the compared rays that are contradicted exceeds 3 %, and its standard deviation.

    Rays of one photo are right or wrong together where it was measured, or oriented, wrong: the deviation is that of a
    ratio of sums over photos (Cochran 1977, 6.4), and at least that of independent rays.
    """
    photos = len(rays.photos)
    compared = np.bincount(rays.photo[votes.compared], minlength=photos)
    number = int(compared.sum())
    if not number:
        return 0.0, math.inf
    contradicted = np.bincount(rays.photo[votes.compared & votes.contradicted], minlength=photos)
    part = int(contradicted.sum()) / number
    together = float(np.square(contradicted - part * compared).sum())
    alone = _MANY * (1.0 - _MANY) * number
    return part - _MANY, math.sqrt(max(together, alone)) / number


def _few(votes: Votes) -> bool:
    """Tell whether so few of the rays that were compared are contradicted that the usual limits suffice."""
    return bool(np.count_nonzero(votes.contradicted) <= _MANY * np.count_nonzero(votes.compared))


def _contradicted(rays: ImageRays, comparison: RayComparison) -> BoolArray:
    """Return which rays (n,) others contradict, beginning with a comparison of all of them."""
    left = np.arange(len(rays.photo))
    for _ in range(_PASSES):
        votes = comparison.votes()
        rows = np.flatnonzero(~votes.contradicted)
        left = left[rows]
        if _few(votes):
            break
        comparison = comparison.of(rows)
    contradicted = np.ones(len(rays.photo), dtype=bool)
    contradicted[left] = False
    return contradicted


# Three photos say little of a ray where few of their points are right in all three: of many points in some blocks
# nothing agrees, and right rays are left out with the wrong ones, among them those that tie the parts. In a part that
# has been grown and adjusted a ray is compared with all others of its point, at positions of known photos.

_ROUNDS = 8
"""How often parts are grown: of more rays they become larger, and tell more rays."""

_FEW_CHANGED = 0.01
"""Part of the rays; where fewer change, the parts stay, and the next round changes hardly any."""

_ENOUGH_RAYS = 3
"""Rays that meet in a point: two may do so by chance, where a wrong one lies near the epipolar line."""


def confirmed_by_parts(measured: MeasuredBlock) -> MeasuredBlock:
    """Return a block with those of all its rays that its parts confirm, and without those that they contradict.

    Rays on which no part decides stay as they are. More points of each photo are kept, for few may tie the parts. What
    has grown last stays for the routes of the block: hardly any of the rays from which it has grown is no longer
    confirmed.
    """
    measured = measured.with_rays(_confirmed(measured), MORE)
    for _ in range(1, _ROUNDS):
        confirmed = _confirmed(measured)
        if np.count_nonzero(confirmed != measured.confirmed) <= _FEW_CHANGED * len(confirmed):
            return replace(measured, confirmed=confirmed)
        measured = measured.with_rays(confirmed, MORE)
    return measured


def _confirmed(measured: MeasuredBlock) -> BoolArray:
    """Return which of all rays (n,) are right as the parts that grow from the confirmed ones show them."""
    right, paired, wrong = np.zeros((3, len(measured.confirmed)), dtype=bool)
    for part in by_pairs(measured.grower(), 0).systems:
        fits, number = _fitting(part, measured.all_rays, measured.confirmed)
        many = number >= _ENOUGH_RAYS
        right |= fits & many
        paired |= fits
        wrong |= part.oriented[measured.all_rays.photo] & ~fits & many
    return np.asarray(right | ((measured.confirmed | paired) & ~wrong))


def _fitting(part: GrowingBlock, all_rays: ImageRays, confirmed: BoolArray) -> tuple[BoolArray, IntArray]:
    """Return which rays (n,) of the photos of a part meet others of it, and how many (n,) meet in their points."""
    rays = part.corrected(all_rays)
    found = intersect(part.rotations, part.centres, part.oriented, rays.of(confirmed))
    points = len(rays.points)
    mine = part.oriented[rays.photo]
    doubtful = np.ones(points, dtype=bool)
    scale = max(found.s0, 1.0)
    positions = with_consensus(part.rotations, part.centres, rays, doubtful, found.coordinates, scale)
    rows = np.flatnonzero(mine & np.isfinite(positions[rays.point, 0]))
    photo, point = rays.photo[rows], rays.point[rows]
    seen = PhotoRays(part.centres[photo], part.rotations[photo], rays.vectors[rows], scale * rays.error[rows])
    fits = np.zeros(len(mine), dtype=bool)
    fits[rows] = seen.squares(positions[point]) <= LIMIT_OF_TWO_COMPONENTS**2
    number = np.bincount(rays.point[fits], minlength=points)[rays.point]
    return fits & (number > 1), number
