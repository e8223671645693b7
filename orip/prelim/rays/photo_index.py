"""Which rays belong to which photo, sorted once, so that the common points of two photos are found quickly."""

from __future__ import annotations

import numpy as np
from msgspec import Struct

from orip.arrays import IntArray
from orip.prelim.rays.image_rays import ImageRays


class PhotoIndex(Struct, frozen=True):
    """Rows of `ImageRays` by photo.

    Parameters
    ----------
    rows : tuple of arrays of int
        For each photo its rows, by ascending point.
    points : tuple of arrays of int
        For each photo the points of these rows.
    """

    rows: tuple[IntArray, ...]
    points: tuple[IntArray, ...]

    def common_points(self, left: int, right: int) -> tuple[IntArray, IntArray]:
        """Return the rows of the points common to two photos: those of the left and those of the right photo."""
        in_left, in_right = in_both(self.points[left], self.points[right])
        return self.rows[left][in_left], self.rows[right][in_right]


def in_both(one: IntArray, other: IntArray) -> tuple[IntArray, IntArray]:
    """Return the places, in each of two ascending lists of indices, of those that occur in both."""
    place = other.searchsorted(one)
    in_one = (place < other.searchsorted(one, side="right")).nonzero()[0]
    return in_one, place[in_one]


def photo_index(rays: ImageRays) -> PhotoIndex:
    """Sort rays by photo; a photo has at most one ray of a point."""
    order = np.lexsort((rays.point, rays.photo))
    starts = np.searchsorted(rays.photo[order], np.arange(1, len(rays.photos)))
    rows = tuple(np.split(order, starts)) if rays.photos else ()
    return PhotoIndex(rows, tuple(rays.point[of_photo] for of_photo in rows))
