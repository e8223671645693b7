"""How well a block fits its rays, compared with what their a-priori errors let expect."""

from __future__ import annotations

import math

import numpy as np

from orip.adjustment.weights import LIMIT_OF_TWO_COMPONENTS
from orip.arrays import BoolArray, FloatArray
from orip.prelim.rays.image_rays import ImageRays

_PHOTO, _POINT = 6, 3
"""Unknowns."""

_STRONG = 10.0
"""Redundancy per photo."""

_LIMIT = 3.1
"""Of a normal deviate: chance exceeds it once in a thousand blocks."""


def robust_square_sum(lengths: FloatArray) -> float:
    """Return the sum of the squares of residual lengths (n,), large ones counted as the limit for blunders.

    NaN does not count.
    """
    return float((np.minimum(lengths[~np.isnan(lengths)], LIMIT_OF_TWO_COMPONENTS) ** 2).sum())


def redundancy(rays: ImageRays, held_points: BoolArray, used: BoolArray) -> int:
    """Return the redundancy of an adjustment of photos and points.

    Parameters
    ----------
    rays : ImageRays
    held_points : array (number of points,) of bool
        Control that does not move.
    used : array (n,) of bool
        Rays that take part, and so do their photos and points.
    """
    points = len(np.unique(rays.point[used & ~held_points[rays.point]]))
    photos = len(np.unique(rays.photo[used]))
    unknowns = _PHOTO * photos + _POINT * points + int(np.count_nonzero(rays.cameras.unknown))
    return int(2 * np.count_nonzero(used)) - unknowns


def rays_that_count(rays: ImageRays, photos: BoolArray, held_points: BoolArray) -> BoolArray:
    """Return which rays (n,) of some photos determine something: of points held, or seen by two of the photos."""
    used = photos[rays.photo]
    number = np.bincount(rays.point[used], minlength=len(rays.points))
    return np.asarray(used & ((number >= 2) | held_points)[rays.point])


def is_strong(redundancy: int, photos: int) -> bool:
    """Tell whether a wrong block cannot nearly fit its rays, as it can where few of them are redundant."""
    return redundancy >= _STRONG * photos


def fits_by_chance(square_sum: float, redundancy: int) -> bool:
    """Tell whether a sum of squares is no larger than measuring errors as large as the a-priori ones explain.

    Notes
    -----
    The quantile of chi-square is that of Wilson and Hilferty (1931).
    """
    degrees = max(redundancy, 1)
    variance = 2.0 / (9.0 * degrees)
    return square_sum <= degrees * (1.0 - variance + _LIMIT * math.sqrt(variance)) ** 3
