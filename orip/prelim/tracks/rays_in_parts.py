"""Which rays the parts of a block confirm that has been grown from those that three photos confirm.

Three photos say little of a ray where few of their points are right in all three: of many points in some blocks nothing
agrees, and right rays are left out with the wrong ones, among them those that tie the parts. In a part that has been
grown and adjusted a ray is compared with all others of its point, at positions of known photos.
"""

from __future__ import annotations

import numpy as np

from orip.adjustment.weights import LIMIT_OF_TWO_COMPONENTS
from orip.arrays import BoolArray, IntArray
from orip.geometry.ray_consensus import PhotoRays
from orip.prelim.growing.growing_block import GrowingBlock
from orip.prelim.intersection.consensus import with_consensus
from orip.prelim.intersection.intersection import intersect
from orip.prelim.measured_block import MORE, MeasuredBlock
from orip.prelim.rays.image_rays import ImageRays
from orip.prelim.routes import by_pairs
from orip.structs import replace

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
