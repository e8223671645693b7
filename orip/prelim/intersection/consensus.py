"""Points of a block placed where most of their rays meet, whatever part of the rays is wrong."""

from __future__ import annotations

import numpy as np

from orip.adjustment.weights import LIMIT_OF_TWO_COMPONENTS
from orip.arrays import BoolArray, FloatArray
from orip.geometry.ray_consensus import OF_TWO, PhotoRays, where_most_rays_meet
from orip.prelim.compiled import is_compiled, kernels
from orip.prelim.rays.image_rays import ImageRays


def with_consensus(
    rotations: FloatArray, centres: FloatArray, rays: ImageRays, doubtful: BoolArray, start: FloatArray, scale: float
) -> FloatArray:
    """Return the coordinates of points, the doubtful ones moved to where most of their rays meet.

    Parameters
    ----------
    rotations : array (p, 3, 3)
        Photo to ground.
    centres : array (p, 3)
        NaN for photos that are not oriented.
    rays : ImageRays
    doubtful : array (q,) of bool
    start : array (q, 3)
        Where the points are; NaN where not known.
    scale : float
        Of the residuals, in a-priori errors.

    Returns
    -------
    array (q, 3)
    """
    return (_point_by_point if is_compiled() else _all_at_once)(rotations, centres, rays, doubtful, start, scale)


def _point_by_point(
    rotations: FloatArray, centres: FloatArray, rays: ImageRays, doubtful: BoolArray, start: FloatArray, scale: float
) -> FloatArray:
    """Do what `_all_at_once` does in the compiled loop."""
    order, starts = rays.order_by_point(), rays.point_starts()
    arrays = rays.photo[order], starts, rays.vectors[order], rays.error[order], rotations, centres
    oriented, found = np.isfinite(centres[:, 0]), np.array(start)
    limit = (OF_TWO * LIMIT_OF_TWO_COMPONENTS) ** 2
    kernels.consensus(*map(np.ascontiguousarray, (*arrays, oriented, doubtful)), found, scale, limit)
    return found


def _all_at_once(
    rotations: FloatArray, centres: FloatArray, rays: ImageRays, doubtful: BoolArray, start: FloatArray, scale: float
) -> FloatArray:
    rows = np.flatnonzero(doubtful[rays.point] & np.isfinite(centres[rays.photo, 0]))
    photo = rays.photo[rows]
    seen = PhotoRays(centres[photo], rotations[photo], rays.vectors[rows], scale * rays.error[rows])
    return where_most_rays_meet(seen, rays.point[rows], start, LIMIT_OF_TWO_COMPONENTS)
