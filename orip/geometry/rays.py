"""Rays: the ground point nearest to the rays that see it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from orip.arrays import FloatArray, parts

_PARALLEL = 5e-11
"""Least det(N) / (II(N) tr(N)) of the normal matrix N of rays that meet: for two rays an eighth of the square of their
angle. Below it they are parallel to working precision."""

_AT_ORIGIN = 1e-3
"""Of a typical distance: points of one block differ less in distance."""


def intersect_rays(
    origins: FloatArray, directions: FloatArray, point_index: NDArray[np.int64], point_count: int
) -> FloatArray:
    """Return for each point the position with the smallest sum of squared distances to its rays.

    Parameters
    ----------
    origins, directions : arrays (n, 3)
        Projection centres and ray directions (any length), ground system.
    point_index : array (n,)
        Point that each ray belongs to.
    point_count : int

    Returns
    -------
    array (point_count, 3)
        NaN for a point with fewer than two rays, or with parallel rays.

    Notes
    -----
    Linear: sum (I - d d^T) X = sum (I - d d^T) X0, solved by the adjoint matrix.
    """
    meeting = RayMeeting(origins.mean(axis=0) if len(origins) else np.zeros(3), point_count)
    meeting.add(origins, directions, point_index)
    return meeting.positions()


class RayMeeting:
    """The sums of rays that tell where those of each point meet, as `intersect_rays`; rays may come some at a time.

    Parameters
    ----------
    base : array (3,)
        A place near the rays, from which distances are taken, so that large coordinates cost no digits.
    point_count : int
    """

    def __init__(self, base: FloatArray, point_count: int) -> None:
        self._base = base
        self._normals = np.zeros((6, point_count))
        self._right = np.zeros((3, point_count))

    def add(self, origins: FloatArray, directions: FloatArray, point_index: NDArray[np.int64]) -> None:
        """Add rays; arguments as of `intersect_rays`."""
        dx, dy, dz = np.array(directions.T, order="C")  # a row for each axis: passes along it are quick
        length = np.sqrt(dx * dx + dy * dy + dz * dz)
        dx, dy, dz = dx / length, dy / length, dz / length
        x, y, z = np.ascontiguousarray(origins.T) - self._base[:, None]
        # I - d d^T has the squares of two components in its diagonal: exact where rays are parallel to an axis
        xx, yy, zz = dx * dx, dy * dy, dz * dz
        along = dx * x + dy * y + dz * z
        for total, values in zip(self._normals, (yy + zz, xx + zz, xx + yy, dy * dz, dx * dz, dx * dy), strict=True):
            np.add.at(total, point_index, values)
        for total, values in zip(self._right, (x - dx * along, y - dy * along, z - dz * along), strict=True):
            np.add.at(total, point_index, values)

    def positions(self) -> FloatArray:
        """Return where the rays of each point meet (point_count, 3), NaN where they do not."""
        count = len(self._right[0])
        found = np.empty((count, 3))
        for part in parts(count):
            found[part] = self._positions_of(part)
        return found

    def _positions_of(self, part: slice) -> FloatArray:
        a, b, c, f, g, h = self._normals[:, part]
        f, g, h = -f, -g, -h
        p, q, r = self._right[:, part]
        # the adjoint of the normal matrix ((a, h, g), (h, b, f), (g, f, c))
        aa, bb, cc = b * c - f * f, a * c - g * g, a * b - h * h
        ff, gg, hh = g * h - a * f, h * f - b * g, f * g - c * h
        determinant = a * aa + h * hh + g * gg
        meets = determinant > _PARALLEL * (aa + bb + cc) * (a + b + c)
        with np.errstate(divide="ignore", invalid="ignore"):  # rays that do not meet
            solved = np.stack([aa * p + hh * q + gg * r, hh * p + bb * q + ff * r, gg * p + ff * q + cc * r], axis=1)
            result = solved / determinant[:, None] + self._base
        result[~meets] = np.nan
        return np.asarray(result)


def points_at_origins(
    positions: FloatArray, origins: FloatArray, point_index: NDArray[np.int64], typical: float
) -> NDArray[np.int64]:
    """Return points whose positions (p, 3) are at the origin of one of the rays (n, 3) that see them.

    Rays from one place meet there only: a position nearer to it than a thousandth of a typical distance is none.
    """
    apart = positions[point_index] - origins
    apart *= apart
    return np.asarray(point_index[apart @ np.ones(3) < (_AT_ORIGIN * typical) ** 2])
