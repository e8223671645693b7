"""Rays: the ground point nearest to the rays that see it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from orip.arrays import FloatArray

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
    # distances are taken from a nearby origin, so that large coordinates cost no digits
    base = origins.mean(axis=0) if len(origins) else np.zeros(3)
    dx, dy, dz = np.ascontiguousarray(directions.T) / np.sqrt(np.einsum("ij,ij->i", directions, directions))
    x, y, z = np.ascontiguousarray(origins.T) - base[:, None]

    def total(values: FloatArray) -> FloatArray:
        return np.bincount(point_index, values, point_count).astype(np.float64, copy=False)

    # I - d d^T has the squares of two components in its diagonal: exact where rays are parallel to an axis
    xx, yy, zz = dx * dx, dy * dy, dz * dz
    a, b, c = total(yy + zz), total(xx + zz), total(xx + yy)
    f, g, h = -total(dy * dz), -total(dx * dz), -total(dx * dy)
    along = dx * x + dy * y + dz * z
    p, q, r = total(x - dx * along), total(y - dy * along), total(z - dz * along)
    # the adjoint of the normal matrix ((a, h, g), (h, b, f), (g, f, c))
    aa, bb, cc = b * c - f * f, a * c - g * g, a * b - h * h
    ff, gg, hh = g * h - a * f, h * f - b * g, f * g - c * h
    determinant = a * aa + h * hh + g * gg
    meets = determinant > _PARALLEL * (aa + bb + cc) * (a + b + c)
    with np.errstate(divide="ignore", invalid="ignore"):  # rays that do not meet
        solved = np.stack([aa * p + hh * q + gg * r, hh * p + bb * q + ff * r, gg * p + ff * q + cc * r], axis=1)
        result = solved / determinant[:, None] + base
    result[~meets] = np.nan
    return np.asarray(result)


def without_near_points(
    positions: FloatArray, origins: FloatArray, point_index: NDArray[np.int64], typical: float
) -> FloatArray:
    """Return positions (p, 3), NaN for points that are at the origin of one of their rays.

    Rays from one place meet there only: a position nearer to it than a thousandth of a typical distance is rejected.
    """
    distance = np.linalg.norm(positions[point_index] - origins, axis=1)
    found = positions.copy()
    found[point_index[distance < _AT_ORIGIN * typical]] = np.nan
    return found
