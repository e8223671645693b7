"""Rays: the ground point nearest to the rays that see it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from orip.arrays import FloatArray

_PARALLEL = 1e-10
"""Smallest ratio of eigenvalues at which rays still meet; below it they are parallel to working precision."""

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
    Linear: sum (I - d d^T) X = sum (I - d d^T) X0.
    """
    unit = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    projector = unit[:, :, None] * unit[:, None, :]
    np.subtract(np.eye(3), projector, out=projector)
    # distances are taken from a nearby origin, so that large coordinates cost no digits
    base = origins.mean(axis=0) if len(origins) else np.zeros(3)
    moved = (projector @ (origins - base)[:, :, None])[:, :, 0]
    matrix = np.empty((point_count, 3, 3))
    right = np.empty((point_count, 3))
    for row in range(3):
        right[:, row] = np.bincount(point_index, moved[:, row], point_count)
        for column in range(row + 1):
            matrix[:, row, column] = np.bincount(point_index, projector[:, row, column], point_count)
            matrix[:, column, row] = matrix[:, row, column]
    eigenvalues = np.linalg.eigvalsh(matrix)
    meets = eigenvalues[:, 0] > _PARALLEL * np.maximum(eigenvalues[:, 2], 1e-300)
    matrix[~meets] = np.eye(3)
    result = np.linalg.solve(matrix, right[:, :, None])[:, :, 0] + base
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
