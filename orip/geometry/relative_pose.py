"""The pose of one photo in the system of another one, with its partials by the poses of both."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from orip.arrays import FloatArray
from orip.geometry.rotation import cross_matrix


class RelativePoses(NamedTuple):
    """Poses of second photos in the systems of first ones, n pairs.

    Attributes
    ----------
    base : array (n, 3)
        Projection centre of the second photo in the system of the first.
    rotation : array (n, 3, 3)
        From the second photo to the first.
    by_first, by_second : arrays (n, 6, 6)
        Partials of the base, and of small rotations about the axes of the first photo, by the projection centre and
        small rotations about the ground axes (radians) of either photo.
    """

    base: FloatArray
    rotation: FloatArray
    by_first: FloatArray
    by_second: FloatArray


def relative_poses_with_partials(
    first_centres: FloatArray, first_rotations: FloatArray, second_centres: FloatArray, second_rotations: FloatArray
) -> RelativePoses:
    """Return base b = R1ᵀ (c2 - c1) and rotation M = R1ᵀ R2 of n pairs of photos.

    With R -> Exp([δ]x) R the changes are db = R1ᵀ (dc2 - dc1 + [c2 - c1]x δ1) and M -> Exp([ε]x) M, ε = R1ᵀ (δ2 - δ1).

    Parameters
    ----------
    first_centres, second_centres : arrays (n, 3)
    first_rotations, second_rotations : arrays (n, 3, 3)
        Photo to ground.
    """
    back = np.swapaxes(first_rotations, 1, 2)
    between = second_centres - first_centres
    by_second = np.zeros((len(back), 6, 6))
    by_second[:, :3, :3] = by_second[:, 3:, 3:] = back
    by_first = -by_second
    by_first[:, :3, 3:] = back @ cross_matrix(between)
    base = (back @ between[:, :, None])[:, :, 0]
    return RelativePoses(base, back @ second_rotations, by_first, by_second)
