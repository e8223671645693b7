"""Planes fitted to groups of points, all of them at once."""

from __future__ import annotations

from itertools import combinations_with_replacement
from typing import NamedTuple

import numpy as np

from orip.arrays import FloatArray, IntArray


class FittedPlanes(NamedTuple):
    """The planes of k groups of points, from which the square sum of distances is least; those of no points are at 0.

    Attributes
    ----------
    number : array (k,) of int
        Points of each group.
    middle, normal : arrays (k, 3)
    extent : array (k, 3)
        Root mean square distances of the points from their middle along the normal and the two axes of the plane, in
        ascending order.
    """

    number: IntArray
    middle: FloatArray
    normal: FloatArray
    extent: FloatArray

    def beside(self, places: FloatArray, group: int | slice = slice(None)) -> FloatArray:
        """Return the distances (n,) of places (n, 3) from the plane of a group, or each from that of its own."""
        return np.asarray(np.sum((places - self.middle[group]) * self.normal[group], axis=1))


def fitted_planes(points: FloatArray, group: IntArray, count: int) -> FittedPlanes:
    """Return the planes of `count` groups of points (n, 3), given the group (n,) of each."""
    number = np.bincount(group, minlength=count)
    divisor = np.maximum(number, 1)

    def means(values: FloatArray) -> FloatArray:
        return np.bincount(group, values, count) / divisor

    apart = np.array(points.T, order="C")
    middle = np.stack([means(values) for values in apart], axis=1)
    apart -= middle.T[:, group]
    squares = np.empty((count, 3, 3))
    for a, b in combinations_with_replacement(range(3), 2):
        squares[:, a, b] = squares[:, b, a] = means(apart[a] * apart[b])
    values, axes = np.linalg.eigh(squares)  # ascending
    return FittedPlanes(number, middle, axes[:, :, 0], np.sqrt(np.maximum(values, 0.0)))
