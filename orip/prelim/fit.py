"""How well a block fits its rays, compared with what their a-priori errors let expect."""

from __future__ import annotations

import math

import numpy as np

from orip.adjustment.weights import LIMIT_OF_TWO_COMPONENTS
from orip.arrays import BoolArray, FloatArray
from orip.prelim.growing_block import GrowingBlock
from orip.prelim.image_rays import ImageRays

_PHOTO, _POINT, _CAMERA = 6, 3, 4
"""Unknowns."""

_LIMIT = 3.1
"""Of a normal deviate: chance exceeds it once in a thousand blocks."""


def robust_square_sum(lengths: FloatArray) -> float:
    """Return the sum of the squares of residual lengths (n,), large ones counted as the limit for blunders.

    NaN does not count.
    """
    return float((np.minimum(lengths[~np.isnan(lengths)], LIMIT_OF_TWO_COMPONENTS) ** 2).sum())


def redundancy(rays: ImageRays, grown: GrowingBlock, held_points: BoolArray, lengths: FloatArray) -> int:
    """Return the redundancy of the oriented photos and their points.

    Parameters
    ----------
    rays : ImageRays
    grown : GrowingBlock
    held_points : array (number of points,) of bool
        Control that does not move.
    lengths : array (n,)
        Residuals of the rays; NaN for a ray that tells nothing.
    """
    used = ~np.isnan(lengths)
    points = len(np.unique(rays.point[used & ~held_points[rays.point]]))
    unknowns = _PHOTO * np.count_nonzero(grown.oriented) + _POINT * points + _CAMERA * len(grown.corrections)
    return int(2 * np.count_nonzero(used) - unknowns)


def fits_by_chance(square_sum: float, redundancy: int) -> bool:
    """Tell whether a sum of squares is no larger than measuring errors as large as the a-priori ones explain.

    Notes
    -----
    The quantile of chi-square is that of Wilson and Hilferty (1931).
    """
    degrees = max(redundancy, 1)
    variance = 2.0 / (9.0 * degrees)
    return square_sum <= degrees * (1.0 - variance + _LIMIT * math.sqrt(variance)) ** 3
