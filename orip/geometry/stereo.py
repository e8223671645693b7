"""Two photos: the essential matrix and relative pose; in stereo the axes of their model, where rays meet, y-parallax.

Numbers and arrays (n,) alike: the plate processor's loop has one point at a time.

Model axes, in ground units: the origin is the left projection centre, x runs along the base to the right projection
centre, z is the mean of both cameras' z axes made perpendicular to the base and points towards the cameras, y = z × x.

The y-parallax is that of the photos rectified to the model's axes: with a ray's direction (dx, dy, dz) there, it is the
difference left minus right of −C dy / dz, with C the mean principal distance, in mm. It is zero exactly when the two
rays lie in one plane with the base, that is, when they meet.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Generic, NamedTuple

import numpy as np
from numpy.typing import NDArray

from orip.arrays import FloatArray, Number
from orip.geometry.rotation import cross_matrix, rotated, rotated_back

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


PARALLEL = 1e-10
"""Square of the sine of the angle at which rays count as parallel: two seconds of arc."""

_NO_BASE = 1e-9
"""Part of the distance of the projection centres from the origin up to which they coincide."""

_ALONG_BASE = 1e-6
"""Least component of the mean viewing direction across the base that determines the model's z axis."""


class Meeting(NamedTuple, Generic[Number]):
    """Where two rays come nearest to each other.

    Attributes
    ----------
    sine_square : number or array (n,)
        Square of the sine of the angle between them.
    along_left, along_right : numbers or arrays (n,)
        How far along each, in lengths of its direction.
    middle : tuple (X, Y, Z)
        The middle of the common perpendicular, which has the least square sum of distances to both.
    """

    sine_square: Number
    along_left: Number
    along_right: Number
    middle: tuple[Number, Number, Number]


def axes_of_model(
    left: Sequence[float] | FloatArray,
    right: Sequence[float] | FloatArray,
    left_z: Sequence[float] | FloatArray,
    right_z: Sequence[float] | FloatArray,
) -> FloatArray | None:
    """Return the matrix (3, 3) from model axes to ground axes.

    None where there are no such axes: the centres coincide, or both cameras look along the base.

    Parameters
    ----------
    left, right : arrays (3,)
        Projection centres.
    left_z, right_z : arrays (3,)
        The cameras' z axes on the ground.
    """
    first, second = np.asarray(left), np.asarray(right)
    base = second - first
    length = float(np.linalg.norm(base))
    if not _NO_BASE * float(np.abs([first, second]).max()) < length < np.inf:
        return None
    ex = base / length
    mean = 0.5 * (np.asarray(left_z) + np.asarray(right_z))
    across = mean - (mean @ ex) * ex
    if not float(np.linalg.norm(across)) > _ALONG_BASE:
        return None
    ez = across / np.linalg.norm(across)
    return np.column_stack([ex, np.cross(ez, ex), ez])


def meeting(
    start: tuple[float, float, float],
    end: tuple[float, float, float],
    left: tuple[Number, ...],
    right: tuple[Number, ...],
) -> Meeting[Number]:
    """Return where the rays of two photos meet.

    Parameters
    ----------
    start, end : tuples (X, Y, Z)
        Projection centres of the left and the right photo.
    left, right : tuples of three numbers or arrays (n,)
        Directions of the rays, of any length.
    """
    bx, by, bz = (b - a for a, b in zip(start, end, strict=True))
    (ax, ay, az), (cx, cy, cz) = left, right
    aa, cc, ac = ax * ax + ay * ay + az * az, cx * cx + cy * cy + cz * cz, ax * cx + ay * cy + az * cz
    nx, ny, nz = ay * cz - az * cy, az * cx - ax * cz, ax * cy - ay * cx
    square = nx * nx + ny * ny + nz * nz
    ba, bc = bx * ax + by * ay + bz * az, bx * cx + by * cy + bz * cz
    # parallel rays meet nowhere; the floor keeps plain numbers from dividing by zero
    along_left, along_right = (ba * cc - bc * ac) / (square + 1e-300), (ba * ac - bc * aa) / (square + 1e-300)
    x0, y0, z0 = start
    middle = (
        x0 + 0.5 * (bx + along_left * ax + along_right * cx),
        y0 + 0.5 * (by + along_left * ay + along_right * cy),
        z0 + 0.5 * (bz + along_left * az + along_right * cz),
    )
    return Meeting(square / (aa * cc), along_left, along_right, middle)


def y_parallax(axes: tuple[float, ...], c: float, left: tuple[Number, ...], right: tuple[Number, ...]) -> Number:
    """Return the y-parallax of two rays, mm.

    Parameters
    ----------
    axes : tuple of 9 floats
        Model axes to ground axes, row by row.
    c : float
        Mean principal distance, mm.
    left, right : tuples of three numbers or arrays (n,)
        Directions of the rays on the ground.
    """
    return rectified(axes, c, *left)[1] - rectified(axes, c, *right)[1]


def rectified(axes: tuple[float, ...], c: float, x: Number, y: Number, z: Number) -> tuple[Number, Number]:
    """Return where rays with the directions (x, y, z) on the ground are in the rectified photo, mm.

    What one ray has of y, all have that lie in one plane with it and the base: epipolar lines are rows. Only rays with
    a component against the model's z axis have such an image.

    Parameters
    ----------
    x, y, z : numbers or arrays (n,)
    """
    along, across, depth = rotated_back(axes, x, y, z)
    # a ray in the plane of the base has no such image; the floor keeps plain numbers from dividing by zero
    return -c * (along / (depth - 1e-300)), -c * (across / (depth - 1e-300))


def ray_of_rectified(axes: tuple[float, ...], c: float, x: Number, y: Number) -> tuple[Number, Number, Number]:
    """Return the directions on the ground of places in the rectified photo: the inverse of `rectified`."""
    return rotated(axes, x, y, 0.0 * x - c)
