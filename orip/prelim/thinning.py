"""Fewer rays: photos with hundreds of points are oriented as well, and many times faster, by some dozens of them."""

from __future__ import annotations

from dataclasses import replace
from itertools import compress

import numpy as np
from numpy.typing import NDArray

from orip.model.preliminary import ImageRays

BoolArray = NDArray[np.bool_]

_ENOUGH = 50
"""Points of a photo that are kept at least, if it has as many."""


def thinned(rays: ImageRays, kept: BoolArray) -> ImageRays:
    """Return the rays of so many points that each photo has enough of them; points that are left out have no index.

    Of each photo those points are taken that most other photos show, since they hold the block together; among equals
    as a fixed shuffle has them, as neighbours in a list of names are often neighbours on the ground.

    Parameters
    ----------
    rays : ImageRays
    kept : array (number of points,) of bool
        Points that are kept in any case: those that are known on the ground.
    """
    per_photo = np.bincount(rays.photo, minlength=len(rays.photos))
    if len(per_photo) == 0 or np.median(per_photo) <= 2 * _ENOUGH:
        return rays
    number = np.bincount(rays.point, minlength=len(rays.points))
    shuffle = np.random.default_rng(0).permutation(len(rays.points))
    order = np.lexsort((shuffle[rays.point], -number[rays.point], rays.photo))
    rank = np.empty(len(order), dtype=np.int64)
    rank[order] = np.arange(len(order)) - np.repeat(np.cumsum(per_photo) - per_photo, per_photo)
    chosen = kept & (number > 0)
    chosen[rays.point[(rank < _ENOUGH) & (number[rays.point] > 1)]] = True
    part = rays.of(chosen[rays.point])
    place = np.cumsum(chosen) - 1
    return replace(part, points=tuple(compress(rays.points, chosen)), point=place[part.point])
