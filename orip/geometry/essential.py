"""The essential matrix of two photos, and the pose of one of them in the system of the other."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from orip.arrays import FloatArray
from orip.geometry.rotation import cross_matrix

# Image vectors are (x, y, -C) in the photo systems, of any length; the ground is the left photo's system. With the base
# b and R from the right photo to the left one, E = [b]x R, and the rays of a point lie in one plane with the base where
# left^T E right = -b · (left × R right) = 0.


class TwoPhotos(NamedTuple):
    """Base and rotation of pairs of photos.

    Attributes
    ----------
    base : array (..., 3)
        Unit vector from the left to the right projection centre, left photo's system.
    rotation : array (..., 3, 3)
        Right photo to left photo.
    """

    base: FloatArray
    rotation: FloatArray

    def of(self, rows: NDArray[np.int64]) -> TwoPhotos:
        """Return some of the pairs, by their numbers (k,)."""
        return TwoPhotos(self.base[rows], self.rotation[rows])


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
