"""Whether the known points of a photo agree with an orientation by chance, whatever part of them is wrong."""

from __future__ import annotations

import math

import numpy as np

from orip.arrays import BoolArray, FloatArray

_POINTS_OF_ORIENTATION = 3

SURE = 10.0
"""Logarithm of the factor by which points have to agree better than by chance."""


def fits_beyond_chance(xy: FloatArray, residuals: FloatArray, fitting: BoolArray) -> bool:
    """Tell whether more points fit an orientation of the photo than would if the others were anywhere.

    Parameters
    ----------
    xy : array (n, 2)
        Measured photo coordinates, mm.
    residuals : array (n, 2)
        mm.
    fitting : array (n,) of bool
        The points that fit.

    Notes
    -----
    A-contrario (Moisan and Stival 2004): m of n points have residuals up to r by chance in (n - 3) C(n, m) C(m, 3)
    p^(m - 3) sets, with the probability p of a place within r in the extent of the points.
    """
    n, m = len(xy), int(np.count_nonzero(fitting))
    if m <= _POINTS_OF_ORIENTATION:
        return False
    extent = float(np.prod(np.ptp(xy, axis=0)))
    largest = float((residuals[fitting] ** 2).sum(axis=1).max())
    chance = min(math.pi * largest / max(extent, 1e-300), 1.0)
    if chance <= 0.0:
        return True
    sets = math.log(n - _POINTS_OF_ORIENTATION) + math.log(math.comb(n, m)) + math.log(math.comb(m, 3))
    return sets + (m - _POINTS_OF_ORIENTATION) * math.log(chance) < -SURE
