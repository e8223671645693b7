"""Intersection of rays with arrays, all points side by side; residuals of rays."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from support.prelim_references.iterations import GaussNewton, group_sums, least_squares

from orip.adjustment.weights import LIMIT_OF_TWO_COMPONENTS, danish_weights
from orip.arrays import BoolArray, FloatArray, IntArray
from orip.geometry.rays import PhotoRays, where_most_rays_meet
from orip.prelim.growing_block import GrowingBlock
from orip.prelim.rays import (
    ABSOLUTE_ITERATIONS,
    DANISH_ITERATIONS,
    KEPT,
    LENGTH_AT_QUANTILE,
    MANY,
    QUANTILE,
    SMALLEST_ANGLE,
    ImageRays,
    Intersected,
)


def _with_consensus(
    rotations: FloatArray, centres: FloatArray, rays: ImageRays, doubtful: BoolArray, start: FloatArray, scale: float
) -> FloatArray:
    rows = np.flatnonzero(doubtful[rays.point] & np.isfinite(centres[rays.photo, 0]))
    photo = rays.photo[rows]
    seen = PhotoRays(centres[photo], rotations[photo], rays.vectors[rows], scale * rays.error[rows])
    return where_most_rays_meet(seen, rays.point[rows], start, LIMIT_OF_TWO_COMPONENTS)


class OrientedRays(NamedTuple):
    """m rays of oriented photos: origins and directions (m, 3), angular errors and points (m,), number of points."""

    origins: FloatArray
    directions: FloatArray
    error: FloatArray
    point: IntArray
    points: int

    def of_points(self, rows: BoolArray, points: BoolArray) -> OrientedRays:
        """Return some rays (m,) of some points (q,), which are numbered from 0."""
        place = np.cumsum(points) - 1
        point = place[self.point[rows]]
        return OrientedRays(self.origins[rows], self.directions[rows], self.error[rows], point, int(points.sum()))


def robust_intersection(rays: OrientedRays) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, float]:
    """Intersect the rays of every point, leaving out or weighting down rays that do not fit.

    Parameters
    ----------
    rays : OrientedRays

    Returns
    -------
    coordinates, deviations : arrays (points, 3)
    weight_factors : array (m,)
    angles : array (points,)
    s0 : float
        As in `orip.prelim.rays.Intersected`.
    """
    ones = np.ones(len(rays.point))
    # the first position gives the distances that turn lengths into angles
    points, _ = _solve(rays, ones)
    weights = _angular_weights(rays, points)
    points, _ = _solve(rays, weights)
    residual = _residuals(rays, points)
    s0 = _scale(rays, residual)
    limit = LIMIT_OF_TWO_COMPONENTS * s0
    factors = ones.copy()
    for treat in (_without_one, _reweighted):
        doubtful = np.zeros(rays.points, dtype=bool)
        # a point behind a photo is doubtful too: the comparison with NaN is false
        doubtful[rays.point[~((residual <= limit) | (factors == 0.0))]] = True
        if doubtful.any():
            rows = doubtful[rays.point]
            points[doubtful], factors[rows] = treat(rays.of_points(rows, doubtful), points[doubtful], limit)
            residual = _residuals(rays, points)
    return _judged(rays, points, factors, s0)


def _without_one(rays: OrientedRays, points: FloatArray, limit: float) -> tuple[FloatArray, FloatArray]:
    """Leave out one ray where the others fit without it, and only without it; return positions and weight factors."""
    number = np.bincount(rays.point, minlength=rays.points)
    order = np.argsort(rays.point, kind="stable")
    rank = np.empty(len(order), dtype=np.int64)
    rank[order] = np.arange(len(order)) - np.repeat(np.cumsum(number) - number, number)
    best, left_out, fitting = points.copy(), np.full(rays.points, -1), np.zeros(rays.points, dtype=np.int64)
    for turn in range(min(int(number.max()), MANY)):
        weights = np.where(rank == turn, 0.0, 1.0)
        tried, _ = _solve(rays, weights)
        tried, _ = _solve(rays, weights * _angular_weights(rays, tried))
        bad = ~(_residuals(rays, tried) <= limit) & (rank != turn)
        fits = (np.bincount(rays.point, bad, rays.points) == 0.0) & (turn < number) & (number >= 3)
        best[fits], left_out[fits] = tried[fits], turn
        fitting += fits
    alone = (fitting == 1) & (number <= MANY)
    factors = np.where(alone[rays.point] & (rank == left_out[rays.point]), 0.0, 1.0)
    return np.where(alone[:, None], best, points), factors


class _Estimate(NamedTuple):
    """Positions (points, 3) of points, and weight factors (m,) of their rays."""

    points: FloatArray
    weights: FloatArray


class _RayProblem:
    """Positions of points from rays whose distances count as angles; the weights are a function of the residuals."""

    def __init__(self, rays: OrientedRays, s0: float, weights_of: Callable[[FloatArray], FloatArray]) -> None:
        self._rays, self._s0, self._weights_of = rays, s0, weights_of

    def stepped(self, at: _Estimate, _damping: FloatArray) -> _Estimate:
        points, _ = _solve(self._rays, at.weights * _angular_weights(self._rays, at.points))
        return at._replace(points=points)

    def reweighted(self, at: _Estimate) -> _Estimate:
        residual = np.nan_to_num(_residuals(self._rays, at.points), nan=1e6, posinf=1e6) / self._s0
        return at._replace(weights=self._weights_of(residual))

    def costs(self, at: _Estimate, weights: FloatArray) -> FloatArray:
        return np.array([weights @ _residuals(self._rays, at.points) ** 2])

    def converged(self, _before: _Estimate, _after: _Estimate) -> bool:
        return False


def _reweighted(rays: OrientedRays, points: FloatArray, limit: float) -> tuple[FloatArray, FloatArray]:
    """Return positions and weight factors of the Danish method, begun with least absolute residuals."""
    s0 = limit / LIMIT_OF_TWO_COMPONENTS
    absolute = _RayProblem(rays, s0, lambda residual: 1.0 / np.maximum(residual, 1.0))
    danish = _RayProblem(rays, s0, lambda residual: danish_weights(residual, LIMIT_OF_TWO_COMPONENTS))
    at = absolute.reweighted(_Estimate(points, np.ones(len(rays.point))))
    at = danish.reweighted(least_squares(absolute, at, GaussNewton(), ABSOLUTE_ITERATIONS).best)
    # the weights that the positions were computed with, not those that would follow
    end = least_squares(danish, at, GaussNewton(), DANISH_ITERATIONS, reweightings=DANISH_ITERATIONS - 1)
    return end.best.points, end.best.weights


def _solve(rays: OrientedRays, weights: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return positions (q, 3), NaN where rays are parallel or fewer than two, and normal matrices (q, 3, 3)."""
    d = rays.directions
    projectors = weights[:, None, None] * (np.eye(3) - d[:, :, None] * d[:, None, :])
    sums = group_sums(
        rays.point,
        np.concatenate([projectors.reshape(-1, 9), (projectors @ rays.origins[:, :, None])[:, :, 0]], axis=1),
        rays.points,
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


def _ahead(rays: OrientedRays, points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the distances (m,) of points along their rays, negative behind, and across them."""
    offset = points[rays.point] - rays.origins
    along = np.einsum("mi,mi->m", offset, rays.directions)
    across = np.linalg.norm(offset - along[:, None] * rays.directions, axis=1)
    return along, across


def _angular_weights(rays: OrientedRays, points: FloatArray) -> FloatArray:
    """Return the weights of distances across the rays: one over the squared standard error at the point."""
    along, across = _ahead(rays, points)
    distance = np.hypot(along, across)
    sound = np.isfinite(distance) & (distance > 0.0)
    return 1.0 / (rays.error * np.where(sound, distance, 1.0)) ** 2


def _residuals(rays: OrientedRays, points: FloatArray) -> FloatArray:
    """Return residuals (m,) over their a-priori errors; infinite behind a photo, NaN without a position."""
    along, across = _ahead(rays, points)
    with np.errstate(invalid="ignore"):
        return np.where(along > 0.0, across / np.where(along > 0.0, along, 1.0) / rays.error, along * 0.0 + np.inf)


def _scale(rays: OrientedRays, residual: FloatArray) -> float:
    """Return the robust scale of the residuals: a quantile, corrected for the redundancy."""
    finite = np.isfinite(residual)
    number = np.bincount(rays.point[finite], minlength=rays.points)
    several = number > 2
    tested = finite & several[rays.point]
    tested_rays, points = int(number[several].sum()), int(np.count_nonzero(several))
    if tested_rays <= 10:
        tested, tested_rays, points = finite, int(number.sum()), int(np.count_nonzero(number))
    redundancy = (2 * tested_rays - 3 * points) / (2 * tested_rays) if tested_rays else 0.0
    if redundancy <= 0.0:
        return 1.0
    length = float(np.quantile(residual[tested], QUANTILE))
    return max(1.0, length / float(LENGTH_AT_QUANTILE) / math.sqrt(redundancy))


def _judged(
    rays: OrientedRays, points: FloatArray, factors: FloatArray, s0: float
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, float]:
    along, _ = _ahead(rays, points)
    factors = np.where(along > 0.0, factors, 0.0)
    kept = factors >= KEPT
    number = np.bincount(rays.point[kept], minlength=rays.points)
    angles = _largest_angles(rays, kept)
    # a point behind one of its two photos is not determined by the other alone
    determined = (number >= 2) & (angles >= SMALLEST_ANGLE) & np.isfinite(points).all(axis=1)
    _, normals = _solve(rays, factors * _angular_weights(rays, points))
    deviations = s0 * np.sqrt(np.einsum("qii->qi", _inverse(normals)))
    points = np.where(determined[:, None], points, np.nan)
    deviations = np.where(determined[:, None], deviations, np.nan)
    return points, deviations, np.where(determined[rays.point], factors, 0.0), angles, s0


def _largest_angles(rays: OrientedRays, kept: BoolArray) -> FloatArray:
    """Return the angle (q,) between the kept ray farthest from their mean direction and the one farthest from it."""
    rows = np.flatnonzero(kept)
    point, directions = rays.point[rows], rays.directions[rows]
    mean = group_sums(point, directions, rays.points)
    first = _farthest(point, directions, mean, rays.points)
    second = _farthest(point, directions, first, rays.points)
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


def _intersected(rotations: FloatArray, centres: FloatArray, oriented: BoolArray, rays: ImageRays) -> Intersected:
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


def _residual_lengths(rays: ImageRays, grown: GrowingBlock) -> FloatArray:
    offset = grown.coordinates[rays.point] - grown.centres[rays.photo]
    u = np.einsum("ni,nij->nj", offset, grown.rotations[rays.photo])
    with np.errstate(divide="ignore", invalid="ignore"):
        image = u[:, :2] * (rays.vectors[:, 2] / u[:, 2])[:, None]
        length = np.linalg.norm(image - rays.vectors[:, :2], axis=1) / rays.error
    oriented = grown.oriented[rays.photo]
    together = np.bincount(rays.point[oriented], minlength=len(rays.points))[rays.point] > 1
    lost = oriented & together & ~grown.known[rays.point]
    return np.where(lost, np.inf, np.where(u[:, 2] < 0.0, length, np.where(np.isnan(u[:, 2]), np.nan, np.inf)))
