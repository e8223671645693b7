"""Intersection of all points of a block at once from oriented photos, with wrong rays rejected."""

from __future__ import annotations

import numpy as np
from msgspec import Struct

from orip.adjustment.weights import LEAST_WEIGHT, LIMIT_OF_TWO_COMPONENTS
from orip.arrays import BoolArray, FloatArray
from orip.prelim.compiled import is_compiled, kernels
from orip.prelim.intersection.robust_intersection import (
    ABSOLUTE_ITERATIONS,
    DANISH_ITERATIONS,
    KEPT,
    LENGTH_AT_QUANTILE,
    MANY,
    QUANTILE,
    SMALLEST_ANGLE,
    OrientedRays,
    robust_intersection,
)
from orip.prelim.rays.image_rays import ImageRays


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
    rays : ImageRays

    Returns
    -------
    Intersected

    Notes
    -----
    The sum of squared distances of a point from its rays, each over its distance from the projection centre and thus an
    angle, is least. Where rays of a point do not fit, one is left out if all others fit without it. If that does not
    help, or if it is not clear which, weights follow the Danish method (Krarup, Juhl and Kubik 1980), begun with least
    absolute residuals.
    """
    return (_point_by_point if is_compiled() else _all_at_once)(rotations, centres, oriented, rays)


def _point_by_point(rotations: FloatArray, centres: FloatArray, oriented: BoolArray, rays: ImageRays) -> Intersected:
    """Do what `_all_at_once` does in the compiled loop."""
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


def _all_at_once(rotations: FloatArray, centres: FloatArray, oriented: BoolArray, rays: ImageRays) -> Intersected:
    used = oriented[rays.photo]
    photo = rays.photo[used]
    vectors = rays.vectors[used]
    length = np.linalg.norm(vectors, axis=1)
    seen = OrientedRays(
        centres[photo],
        np.einsum("nij,nj->ni", rotations[photo], vectors / length[:, None]),
        rays.error[used] / length,
        rays.point[used],
        len(rays.points),
    )
    base = seen.origins.mean(axis=0) if len(photo) else np.zeros(3)
    coordinates, deviations, factors, angles, s0 = robust_intersection(seen._replace(origins=seen.origins - base))
    weight_factors = np.zeros(len(used))
    weight_factors[used] = factors
    return Intersected(coordinates + base, deviations, weight_factors, angles, s0)
