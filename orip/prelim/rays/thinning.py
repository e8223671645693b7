"""Thinning of rays: a few dozen points orient a photo as well as hundreds, and many times faster."""

from __future__ import annotations

from itertools import compress

import numpy as np

from orip.arrays import BoolArray, IntArray
from orip.prelim.medians import median
from orip.prelim.rays.image_rays import ImageRays
from orip.structs import replace

_HOLDING = 4
"""Least number of points kept of those that connect two photos."""

_MANY = 1.5
"""Multiple of the points that are enough: if the median photo has fewer, all points are kept."""


def thinned(rays: ImageRays, kept: BoolArray, enough: int) -> ImageRays:
    """Return rays of enough points for each photo; points that are left out have no index.

    In each photo, and in each two photos that are neighbours in the list of photos of a point, those points are kept
    that are in most other photos, since they connect the block; equal ones in the order of a fixed shuffle, as
    neighbours in a list of names are often neighbours on the ground.

    Parameters
    ----------
    rays : ImageRays
    kept : array (number of points,) of bool
        Points that are always kept: those that are known on the ground.
    enough : int
        Least number of points kept in a photo, if it has as many.
    """
    per_photo = np.bincount(rays.photo, minlength=len(rays.photos))
    if len(per_photo) == 0 or median(per_photo.astype(np.float64)) <= _MANY * enough:
        return rays
    rays = rays.of(np.lexsort((rays.photo, rays.point)))
    number = np.bincount(rays.point, minlength=len(rays.points))
    shuffle = np.random.default_rng(0).permutation(len(rays.points))
    worth = np.empty(len(shuffle), dtype=np.int64)
    worth[np.lexsort((shuffle, -number))] = np.arange(len(shuffle))
    chosen = kept & (number > 0)
    shared = np.flatnonzero(number[rays.point] > 1)
    chosen[_first_of_each(rays.photo[shared], rays.point[shared], worth, enough)] = True
    of_joint = np.flatnonzero(rays.point[1:] == rays.point[:-1])
    joint = rays.photo[of_joint] * len(rays.photos) + rays.photo[of_joint + 1]
    chosen[_first_of_each(joint, rays.point[of_joint], worth, _HOLDING)] = True
    part = rays.of(chosen[rays.point])
    place = np.cumsum(chosen) - 1
    return replace(part, points=tuple(compress(rays.points, chosen)), point=place[part.point])


def _first_of_each(group: IntArray, point: IntArray, worth: IntArray, most: int) -> IntArray:
    """Return at most `most` points of each group, those with the lowest rank in `worth` (number of points,) first."""
    order = np.lexsort((worth[point], group))
    ordered = group[order]
    first = np.flatnonzero(np.concatenate([[True], ordered[1:] != ordered[:-1]])) if len(order) else order
    rank = np.arange(len(order)) - np.repeat(first, np.diff(np.append(first, len(order))))
    return point[order[rank < most]]
