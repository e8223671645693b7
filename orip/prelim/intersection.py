"""Intersection of rays from oriented photos: of all that are right, and which those are."""

from __future__ import annotations

import numpy as np
from msgspec import Struct

from orip.adjustment.weights import LEAST_WEIGHT, LIMIT_OF_TWO_COMPONENTS
from orip.arrays import BoolArray, FloatArray
from orip.geometry.rays import OF_TWO
from orip.prelim.compiled import kernels
from orip.prelim.rays import ImageRays


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
    doubtful : array (q,) of bool
    start : array (q, 3)
        Where the points are; NaN where not known.
    scale : float
        Of the residuals, in a-priori errors.

    Returns
    -------
    array (q, 3)
    """
    return _with_consensus(rotations, centres, rays, doubtful, start, scale)


def _with_consensus(
    rotations: FloatArray, centres: FloatArray, rays: ImageRays, doubtful: BoolArray, start: FloatArray, scale: float
) -> FloatArray:
    order, starts = rays.order_by_point(), rays.point_starts()
    arrays = rays.photo[order], starts, rays.vectors[order], rays.error[order], rotations, centres
    oriented, found = np.isfinite(centres[:, 0]), np.array(start)
    limit = (OF_TWO * LIMIT_OF_TWO_COMPONENTS) ** 2
    kernels.consensus(*map(np.ascontiguousarray, (*arrays, oriented, doubtful)), found, scale, limit)
    return found


SMALLEST_ANGLE = np.radians(0.5)
"""Angle below which the depth of an intersection is wrong by some hundred times the error across the rays."""

MANY = 8
"""From this number of rays, least absolute residuals find a wrong one as surely as leaving out one after the other."""

KEPT = 0.5
"""Least weight factor with which a ray counts for the angle and for lying in front."""

ABSOLUTE_ITERATIONS = 10
DANISH_ITERATIONS = 4

QUANTILE = 0.4
LENGTH_AT_QUANTILE = np.sqrt(-2.0 * np.log(1.0 - QUANTILE))
"""Quantile of the length of a residual with two normal components of standard deviation 1; below the median, since a
wrong ray also enlarges the residuals of the other rays of its point."""


class Intersected(Struct, frozen=True):
    """q points from n rays.

    Parameters
    ----------
    coordinates : array (q, 3)
        NaN where a point is not determined: fewer than two rays left, rays nearly parallel, or behind the photos.
    deviations : array (q, 3)
        Standard deviations of the coordinates; NaN likewise.
    weight_factors : array (n,)
        Of the rays; 0 for the ray of a photo that is not oriented, of a point behind it or not determined.
    angles : array (q,)
        Largest angle at which rays of the point meet, radians; 0 with fewer than two rays.
    s0 : float
        Scale of the residuals against the a-priori errors, at least 1.
    """

    coordinates: FloatArray
    deviations: FloatArray
    weight_factors: FloatArray
    angles: FloatArray
    s0: float


def intersect(rotations: FloatArray, centres: FloatArray, oriented: BoolArray, rays: ImageRays) -> Intersected:
    """Intersect the rays of every point.

    Parameters
    ----------
    rotations : array (p, 3, 3)
        Photo to ground.
    centres : array (p, 3)
    oriented : array (p,) of bool
        The rays of other photos are left out.

    Notes
    -----
    The sum of squared distances of a point from its rays, each over its distance from the projection centre and thus an
    angle, is least. Where rays of a point do not fit, one is left out if all others fit without it. If that does not
    help, or if it is not clear which, weights follow the Danish method (Krarup, Juhl and Kubik 1980), begun with least
    absolute residuals.
    """
    return _intersected(rotations, centres, oriented, rays)


def _intersected(rotations: FloatArray, centres: FloatArray, oriented: BoolArray, rays: ImageRays) -> Intersected:
    points = len(rays.points)
    coordinates, deviations, angles = np.empty((points, 3)), np.empty((points, 3)), np.empty(points)
    factors = np.empty(len(rays.photo))
    of_rays = rays.photo, rays.point, rays.vectors, rays.error, rotations, centres, oriented
    s0 = kernels.intersect(
        *map(np.ascontiguousarray, of_rays), coordinates, deviations, factors, angles,
        QUANTILE, LENGTH_AT_QUANTILE, SMALLEST_ANGLE, LIMIT_OF_TWO_COMPONENTS, LEAST_WEIGHT, KEPT, MANY,
        ABSOLUTE_ITERATIONS, DANISH_ITERATIONS,
    )  # fmt: skip
    return Intersected(coordinates, deviations, factors, angles, s0)
