"""Photos as parts of a block of their own, their points in a plane."""

from __future__ import annotations

import numpy as np

from orip.arrays import BoolArray, FloatArray, IntArray
from orip.prelim.rays.image_rays import ImageRays
from orip.records.results.preliminary import PartialBlock

LOOKING_DOWN, UPRIGHT = 2, 1
"""Axes of the photos that may point up."""

FLAT = 0.1
"""Deviation of the depth of points in a single photo, which are taken to lie in a plane, as part of that depth."""

_M = 1e-3
"""Parts are in metres at photo scale."""

_EQUATIONS = 6
"""Of a photo, with as many unknowns."""


def single_photo(rays: ImageRays, photo: int, rows: IntArray) -> PartialBlock:
    """Return a photo with its points in a plane, by its `rows` of the rays."""
    coordinates = _M * rays.vectors[rows]
    return PartialBlock(
        rays.photos[photo],
        np.array([photo]),
        np.eye(3)[None],
        np.zeros((1, 3)),
        rays.point[rows],
        coordinates,
        np.abs(FLAT * coordinates[:, [2, 2, 2]]),
    )


def supported_photos(rays: ImageRays, known: FloatArray) -> BoolArray:
    """Return which photos (number of photos,) may be determined: others and control give them equations enough.

    A point gives two if it is control or if two other photos show it, one if one of them does.

    Parameters
    ----------
    rays : ImageRays
    known : array (number of points, 3)
        Control, NaN where not known.
    """
    control: BoolArray = np.asarray(np.isfinite(known).any(axis=1))
    supported = np.ones(len(rays.photos), dtype=bool)
    while True:
        used = supported[rays.photo]
        others = np.bincount(rays.point[used], minlength=len(rays.points))[rays.point] - 1
        equations = np.where(control[rays.point], 2, np.clip(others, 0, 2))
        enough = np.bincount(rays.photo, weights=equations * used, minlength=len(supported)) >= _EQUATIONS
        if not (supported & ~enough).any():
            return supported
        supported &= enough
