"""Fewer rays: photos with hundreds of points are oriented as well, and many times faster, by some dozens of them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from orip.model.preliminary import ImageRays

BoolArray = NDArray[np.bool_]

_ENOUGH = 50
"""Points of a photo that are kept at least, if it has as many."""


def thinned(rays: ImageRays, kept: BoolArray) -> ImageRays:
    """Return the rays of so many points that each photo has enough of them; photos and points keep their indices.

    Points with most rays come first, since they hold the block together; among equals they are taken in the order of
    their names' places, as evenly as they were measured.

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
    # a fixed shuffle: neighbours in a list of names are often neighbours on the ground
    order = np.random.default_rng(0).permutation(len(rays.points))
    order = order[np.argsort(-number[order], kind="stable")]
    by_point = np.argsort(rays.point, kind="stable")
    starts = np.concatenate([[0], np.cumsum(number)])
    have = np.bincount(rays.photo[kept[rays.point]], minlength=len(rays.photos))
    chosen = kept.copy()
    shared = np.bincount(rays.photo[(number > 1)[rays.point]], minlength=len(rays.photos))
    wanted = np.minimum(shared, _ENOUGH)
    for point in order[(number > 1)[order] & ~kept[order]]:
        photos = rays.photo[by_point[starts[point] : starts[point + 1]]]
        if (have[photos] < _ENOUGH).any():
            chosen[point] = True
            have[photos] += 1
            if (have >= wanted).all():
                break
    return rays.of(chosen[rays.point])
