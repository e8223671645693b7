"""The parallax of a point in two photos: by how much its rays miss each other in the photos, and where they meet.

As in `orip.geometry.essential` the ground is the left photo's system, image vectors are (x, y, -C) in millimetres, and
R takes the right photo's system to the left one's.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from orip.arrays import FloatArray
from orip.geometry.essential import TwoPhotos
from orip.geometry.rotation import cross_matrix


class Pairs(NamedTuple):
    """n points in two photos.

    Attributes
    ----------
    left, right : arrays (n, 3)
        Image vectors, mm.
    error : array (n,)
        A-priori standard deviation of a parallax, mm: sqrt(2) times that of a photo coordinate.
    """

    left: FloatArray
    right: FloatArray
    error: FloatArray

    def of(self, rows: NDArray[np.bool_]) -> Pairs:
        """Return some of the points."""
        return Pairs(self.left[rows], self.right[rows], self.error[rows])

    def equal(self, others: Pairs) -> bool:
        """Tell whether others are the same points, measured and weighted alike."""
        return all(map(np.array_equal, self, others))


class Parallaxes(NamedTuple):
    """Parallaxes of n points and their partials.

    Attributes
    ----------
    value : array (..., n)
        mm.
    by_base : array (..., n, 3)
        By the base, mm per unit of the base; nothing along the base itself.
    by_rotation : array (..., n, 3)
        By a small rotation of the right photo about the axes of the left one, mm per radian.
    """

    value: FloatArray
    by_base: FloatArray
    by_rotation: FloatArray


class Meeting(NamedTuple):
    """Where the rays of n points come nearest to each other.

    Attributes
    ----------
    coordinates : array (..., n, 3)
        Halfway between the rays, in units of the base; not finite where they are parallel.
    along_left, along_right : arrays (..., n)
        Multiples of the image vectors; negative behind the photo.
    """

    coordinates: FloatArray
    along_left: FloatArray
    along_right: FloatArray

    @property
    def in_front(self) -> NDArray[np.bool_]:
        """Whether the point lies in front of both photos, array (..., n)."""
        return (self.along_left > 0.0) & (self.along_right > 0.0)


def parallaxes(essential: FloatArray, pairs: Pairs) -> FloatArray:
    """Return the parallaxes of n points for essential matrices (..., 3, 3), array (..., n), mm.

    Notes
    -----
    F = left^T E right over the length of its gradient by the four photo coordinates, to first order the shift of both
    image points that makes the rays meet (Sampson 1982), times sqrt(2): in the normal case this is y left - y right.
    """
    f, gradient_left, gradient_right = _condition(essential, pairs)
    return np.asarray(f * np.sqrt(2.0 / _square(gradient_left, gradient_right)))


def parallaxes_with_partials(photos: TwoPhotos, pairs: Pairs) -> Parallaxes:
    """Return the parallaxes of n points and their partials.

    Parameters
    ----------
    photos : TwoPhotos
        The base may have any length.
    pairs : Pairs

    Returns
    -------
    Parallaxes

    Notes
    -----
    E is linear in base and rotation. The derivative of F / |g| by the elements of E is a sum of two dyads of vectors
    of the left and the right photo; with dE = [db]x R and dE = [b]x [dr]x R those become cross products.
    """
    base, to_left = photos.base[..., :, None], photos.rotation
    f, gradient_left, gradient_right = _condition(cross_matrix(photos.base) @ to_left, pairs)
    square = _square(gradient_left, gradient_right)
    value = f * np.sqrt(2.0 / square)
    gradient_left[..., 2, :] = gradient_right[..., 2, :] = 0.0
    left, right = pairs.left.T, to_left @ pairs.right.T
    shrinking = (value / square)[..., None, :]
    left_factor = np.sqrt(2.0 / square)[..., None, :] * left - shrinking * gradient_left
    right_factor = -shrinking * (to_left @ gradient_right)
    by_base = _cross(right, left_factor) + _cross(right_factor, left)
    by_rotation = _cross(_cross(base, left_factor), right) + _cross(_cross(base, left), right_factor)
    return Parallaxes(value, np.swapaxes(by_base, -1, -2), np.swapaxes(by_rotation, -1, -2))


def meeting_points(photos: TwoPhotos, pairs: Pairs) -> Meeting:
    """Return where the rays of n points come nearest to each other, the least squares intersection of two rays."""
    base, left, right = photos.base[..., :, None], pairs.left.T, photos.rotation @ pairs.right.T
    normal = _cross(left, right)
    with np.errstate(divide="ignore", invalid="ignore"):
        scaled = normal / (normal**2).sum(axis=-2, keepdims=True)
        along_left = (_cross(base, right) * scaled).sum(axis=-2)
        along_right = (_cross(base, left) * scaled).sum(axis=-2)
        coordinates = 0.5 * (along_left[..., None, :] * left + base + along_right[..., None, :] * right)
    return Meeting(np.swapaxes(coordinates, -1, -2), along_left, along_right)


# below, vectors of n points are columns (..., 3, n): sums over components are then fast


def _condition(essential: FloatArray, pairs: Pairs) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return F (..., n) and its gradients (..., 3, n) by the left and the right image vectors."""
    gradient_left = essential @ pairs.right.T
    gradient_right = np.swapaxes(essential, -1, -2) @ pairs.left.T
    return (gradient_left * pairs.left.T).sum(axis=-2), gradient_left, gradient_right


def _square(gradient_left: FloatArray, gradient_right: FloatArray) -> FloatArray:
    """Return the square (..., n) of the gradient by the four photo coordinates; never quite zero."""
    x, y = gradient_left[..., 0, :], gradient_left[..., 1, :]
    u, v = gradient_right[..., 0, :], gradient_right[..., 1, :]
    return np.asarray(np.maximum(x * x + y * y + u * u + v * v, 1e-300))


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return the cross products of columns (..., 3, n) or (..., 3, 1)."""
    ax, ay, az = a[..., 0, :], a[..., 1, :], a[..., 2, :]
    bx, by, bz = b[..., 0, :], b[..., 1, :], b[..., 2, :]
    return np.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], axis=-2)
