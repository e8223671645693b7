"""Intersection of all points of a block at once from oriented photos, with wrong rays thrown out."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from orip.adjustment.weights import danish_weights
from orip.arrays import BoolArray, FloatArray, IntArray
from orip.prelim.compiled import LEAST_WEIGHT, is_compiled, kernels
from orip.records.preliminary import ImageRays

SMALLEST_ANGLE = np.radians(0.5)
"""Rays that meet at less leave a depth that is wrong by some hundred times the error across the rays."""

_LIMIT = 3.5
"""3.5: of residuals with two components one good one in 460 is longer."""

_MANY = 8
"""Rays from which on least absolute residuals find a wrong one as surely as leaving out one after the other."""

_KEPT = 0.5
"""Weight factor from which on a ray counts for the angle and for lying in front."""

_NUMBERS_OF_A_RAY = 9
"""Room of the compiled loop: origin, direction, error, residual and one more."""

_ABSOLUTE_ITERATIONS = 10
_DANISH_ITERATIONS = 4

_QUANTILE = 0.4
_LENGTH_AT_QUANTILE = np.sqrt(-2.0 * np.log(1.0 - _QUANTILE))
"""Of a residual with two normal components of standard deviation 1; below the median, since a wrong ray spoils the
residuals of the others of its point as well."""


@dataclass(frozen=True, slots=True)
class Intersected:
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


class _Bundle(NamedTuple):
    """Rays of oriented photos: origins and unit directions (m, 3), angular errors and points (m,), number of points."""

    origins: FloatArray
    directions: FloatArray
    error: FloatArray
    point: IntArray
    points: int

    def of(self, rows: IntArray) -> _Bundle:
        """Return some rays, or all in another order."""
        return _Bundle(self.origins[rows], self.directions[rows], self.error[rows], self.point[rows], self.points)

    def of_points(self, rows: BoolArray, points: BoolArray) -> _Bundle:
        """Return some rays (m,) of some points (q,), which are counted anew."""
        place = np.cumsum(points) - 1
        point = place[self.point[rows]]
        return _Bundle(self.origins[rows], self.directions[rows], self.error[rows], point, int(points.sum()))


def group_sums(index: IntArray, values: FloatArray, count: int) -> FloatArray:
    """Return the sums (count, ...) of the rows of values (n, ...) that have the same index (n,)."""
    columns = values.reshape(len(index), int(np.prod(values.shape[1:]))).T
    sums = np.empty((count, len(columns)))
    for place, column in enumerate(columns):
        sums[:, place] = np.bincount(index, column, count)
    return sums.reshape(count, *values.shape[1:])


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
    count, points = len(rays.photo), len(rays.points)
    ordered = bool((rays.point[1:] >= rays.point[:-1]).all())
    order = slice(None) if ordered else np.argsort(rays.point, kind="stable")
    start = np.zeros(points + 1, dtype=np.int64)
    np.cumsum(np.bincount(rays.point, minlength=points), out=start[1:])
    coordinates, deviations, angles = np.empty((points, 3)), np.empty((points, 3)), np.empty(points)
    factors, factors_in_order = np.empty(count), np.empty(count)
    of_rays = map(np.ascontiguousarray, (rays.vectors[order], rays.error[order], rotations, centres, oriented))
    s0 = kernels.intersect(
        np.ascontiguousarray(rays.photo[order]), start, *of_rays, coordinates, deviations, factors_in_order, angles,
        np.empty((_NUMBERS_OF_A_RAY, count)), np.empty(count + points + 1, dtype=np.int64),
        _QUANTILE, _LENGTH_AT_QUANTILE, SMALLEST_ANGLE, _LIMIT, LEAST_WEIGHT, _KEPT, _MANY, _ABSOLUTE_ITERATIONS,
        _DANISH_ITERATIONS,
    )  # fmt: skip
    factors[order] = factors_in_order
    return Intersected(coordinates, deviations, factors, angles, s0)


def _all_at_once(rotations: FloatArray, centres: FloatArray, oriented: BoolArray, rays: ImageRays) -> Intersected:
    used = oriented[rays.photo]
    photo = rays.photo[used]
    vectors = rays.vectors[used]
    length = np.linalg.norm(vectors, axis=1)
    bundle = _Bundle(
        centres[photo],
        np.einsum("nij,nj->ni", rotations[photo], vectors / length[:, None]),
        rays.error[used] / length,
        rays.point[used],
        len(rays.points),
    )
    base = bundle.origins.mean(axis=0) if len(photo) else np.zeros(3)
    coordinates, deviations, factors, angles, s0 = _robust(bundle._replace(origins=bundle.origins - base))
    weight_factors = np.zeros(len(used))
    weight_factors[used] = factors
    return Intersected(coordinates + base, deviations, weight_factors, angles, s0)


def _robust(bundle: _Bundle) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, float]:
    """Return coordinates, deviations, weight factors of the rays, angles, s0."""
    ones = np.ones(len(bundle.point))
    # the first position gives the distances that turn lengths into angles
    points, _ = _solve(bundle, ones)
    weights = _angular_weights(bundle, points)
    points, _ = _solve(bundle, weights)
    residual = _residuals(bundle, points)
    s0 = _scale(bundle, residual)
    limit = _LIMIT * s0
    factors = ones.copy()
    for treat in (_without_one, _reweighted):
        doubtful = np.zeros(bundle.points, dtype=bool)
        # a point behind a photo is doubtful too: the comparison with NaN is false
        doubtful[bundle.point[~((residual <= limit) | (factors == 0.0))]] = True
        if doubtful.any():
            rows = doubtful[bundle.point]
            points[doubtful], factors[rows] = treat(bundle.of_points(rows, doubtful), points[doubtful], limit)
            residual = _residuals(bundle, points)
    return _judged(bundle, points, factors, s0)


def _without_one(bundle: _Bundle, points: FloatArray, limit: float) -> tuple[FloatArray, FloatArray]:
    """Leave out one ray where the others fit without it, and only without it; return positions and weight factors."""
    number = np.bincount(bundle.point, minlength=bundle.points)
    order = np.argsort(bundle.point, kind="stable")
    rank = np.empty(len(order), dtype=np.int64)
    rank[order] = np.arange(len(order)) - np.repeat(np.cumsum(number) - number, number)
    best, left_out, fitting = points.copy(), np.full(bundle.points, -1), np.zeros(bundle.points, dtype=np.int64)
    for turn in range(min(int(number.max()), _MANY)):
        weights = np.where(rank == turn, 0.0, 1.0)
        tried, _ = _solve(bundle, weights)
        tried, _ = _solve(bundle, weights * _angular_weights(bundle, tried))
        bad = ~(_residuals(bundle, tried) <= limit) & (rank != turn)
        fits = (np.bincount(bundle.point, bad, bundle.points) == 0.0) & (turn < number) & (number >= 3)
        best[fits], left_out[fits] = tried[fits], turn
        fitting += fits
    alone = (fitting == 1) & (number <= _MANY)
    factors = np.where(alone[bundle.point] & (rank == left_out[bundle.point]), 0.0, 1.0)
    return np.where(alone[:, None], best, points), factors


def _reweighted(bundle: _Bundle, points: FloatArray, limit: float) -> tuple[FloatArray, FloatArray]:
    """Return positions and weight factors of the Danish method, begun with least absolute residuals."""
    s0 = limit / _LIMIT
    factors = np.ones(len(bundle.point))
    for iteration in range(_ABSOLUTE_ITERATIONS + _DANISH_ITERATIONS):
        residual = np.nan_to_num(_residuals(bundle, points), nan=1e6, posinf=1e6) / s0
        absolute = iteration < _ABSOLUTE_ITERATIONS
        factors = 1.0 / np.maximum(residual, 1.0) if absolute else danish_weights(residual, _LIMIT)
        points, _ = _solve(bundle, factors * _angular_weights(bundle, points))
    return points, factors


def _solve(bundle: _Bundle, weights: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return positions (q, 3), NaN where rays are parallel or fewer than two, and normal matrices (q, 3, 3)."""
    d = bundle.directions
    projectors = weights[:, None, None] * (np.eye(3) - d[:, :, None] * d[:, None, :])
    sums = group_sums(
        bundle.point,
        np.concatenate([projectors.reshape(-1, 9), (projectors @ bundle.origins[:, :, None])[:, :, 0]], axis=1),
        bundle.points,
    )
    normals, right = sums[:, :9].reshape(-1, 3, 3), sums[:, 9:]
    inverse = _inverse(normals)
    return (inverse @ right[:, :, None])[:, :, 0], normals


def _inverse(normals: FloatArray) -> FloatArray:
    """Return the inverses (q, 3, 3) of symmetric matrices; NaN of singular ones."""
    a, b, c = normals[:, 0], normals[:, 1], normals[:, 2]
    minors = np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)], axis=1)
    determinant = np.einsum("qi,qi->q", a, minors[:, 0])
    trace = np.einsum("qii->q", normals)
    # rays at an angle t leave t² of the trace in the weak direction; 1e-5 rad are parallel to working precision
    regular = determinant > 1e-11 * trace**3
    return np.where(regular[:, None, None], minors / np.where(regular, determinant, 1.0)[:, None, None], np.nan)


def _ahead(bundle: _Bundle, points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the distances (m,) of points along their rays, negative behind, and across them."""
    offset = points[bundle.point] - bundle.origins
    along = np.einsum("mi,mi->m", offset, bundle.directions)
    across = np.linalg.norm(offset - along[:, None] * bundle.directions, axis=1)
    return along, across


def _angular_weights(bundle: _Bundle, points: FloatArray) -> FloatArray:
    """Return the weights of distances across the rays: one over the squared standard error at the point."""
    along, across = _ahead(bundle, points)
    distance = np.hypot(along, across)
    sound = np.isfinite(distance) & (distance > 0.0)
    return 1.0 / (bundle.error * np.where(sound, distance, 1.0)) ** 2


def _residuals(bundle: _Bundle, points: FloatArray) -> FloatArray:
    """Return residuals (m,) over their a-priori errors; infinite behind a photo, NaN without a position."""
    along, across = _ahead(bundle, points)
    with np.errstate(invalid="ignore"):
        return np.where(along > 0.0, across / np.where(along > 0.0, along, 1.0) / bundle.error, along * 0.0 + np.inf)


def _scale(bundle: _Bundle, residual: FloatArray) -> float:
    """Return the robust scale of the residuals: a quantile, freed of the part that the points take up."""
    finite = np.isfinite(residual)
    number = np.bincount(bundle.point[finite], minlength=bundle.points)
    several = number > 2
    tested = finite & several[bundle.point]
    rays, points = int(number[several].sum()), int(np.count_nonzero(several))
    if rays <= 10:
        tested, rays, points = finite, int(number.sum()), int(np.count_nonzero(number))
    redundancy = (2 * rays - 3 * points) / (2 * rays) if rays else 0.0
    if redundancy <= 0.0:
        return 1.0
    length = float(np.quantile(residual[tested], _QUANTILE))
    return max(1.0, length / float(_LENGTH_AT_QUANTILE) / math.sqrt(redundancy))


def _judged(
    bundle: _Bundle, points: FloatArray, factors: FloatArray, s0: float
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, float]:
    along, _ = _ahead(bundle, points)
    factors = np.where(along > 0.0, factors, 0.0)
    kept = factors >= _KEPT
    number = np.bincount(bundle.point[kept], minlength=bundle.points)
    angles = _largest_angles(bundle, kept)
    # a ray that is behind pulled the position to where it is: nothing is left of a point with two rays
    determined = (number >= 2) & (angles >= SMALLEST_ANGLE) & np.isfinite(points).all(axis=1)
    _, normals = _solve(bundle, factors * _angular_weights(bundle, points))
    deviations = s0 * np.sqrt(np.einsum("qii->qi", _inverse(normals)))
    points = np.where(determined[:, None], points, np.nan)
    deviations = np.where(determined[:, None], deviations, np.nan)
    return points, deviations, np.where(determined[bundle.point], factors, 0.0), angles, s0


def _largest_angles(bundle: _Bundle, kept: BoolArray) -> FloatArray:
    """Return the angle (q,) between the kept ray farthest from their mean and the one farthest from that."""
    rows = np.flatnonzero(kept)
    point, directions = bundle.point[rows], bundle.directions[rows]
    mean = group_sums(point, directions, bundle.points)
    first = _farthest(point, directions, mean, bundle.points)
    second = _farthest(point, directions, first, bundle.points)
    return np.asarray(np.arctan2(np.linalg.norm(np.cross(first, second), axis=1), np.einsum("qi,qi->q", first, second)))


def _farthest(point: IntArray, directions: FloatArray, reference: FloatArray, count: int) -> FloatArray:
    """Return for each point the direction (count, 3) farthest from a reference direction (count, 3); 0 without rays."""
    cosine = np.einsum("mi,mi->m", directions, reference[point])
    order = np.lexsort((cosine, point))
    first = np.ones(len(order), dtype=bool)
    first[1:] = point[order][1:] != point[order][:-1]
    result = np.zeros((count, 3))
    result[point[order][first]] = directions[order][first]
    return result
