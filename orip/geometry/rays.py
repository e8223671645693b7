"""Rays: the ground point nearest to those that see it, and where most of them meet, whatever part of them is wrong."""

from __future__ import annotations

from itertools import combinations
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from orip.arrays import BoolArray, FloatArray, IntArray, parts

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


# Positions are tried from each two rays of a point, as in random sample consensus (Fischler and Bolles 1981): half of
# the rays of a point may be wrong where a block has many outliers, and weights of residuals then settle anywhere.

_FEWEST_RAYS, _MOST_RAYS = 3, 10
"""Rays of a point: of two neither can be called wrong; of many the right ones outweigh the others."""

OF_TWO = 2.0


class PhotoRays(NamedTuple):
    """n rays of points, each from a photo.

    Attributes
    ----------
    centres : array (n, 3)
        Projection centres.
    rotations : array (n, 3, 3)
        Photo to ground.
    vectors : array (n, 3)
        Image vectors (x, y, -C).
    error : array (n,)
        Standard deviation of a photo coordinate, in the unit of the vectors.
    """

    centres: FloatArray
    rotations: FloatArray
    vectors: FloatArray
    error: FloatArray

    def squares(self, positions: FloatArray) -> FloatArray:
        """Return the squared standard residuals (n,) of positions (n, 3); infinite behind the photo."""
        u = np.einsum("ni,nij->nj", positions - self.centres, self.rotations)
        in_front = u[:, 2] < 0.0
        scale = self.vectors[:, 2] / np.where(in_front, u[:, 2], -1.0)
        image = u[:, :2] * scale[:, None]
        return np.where(in_front, ((image - self.vectors[:, :2]) ** 2).sum(axis=1) / self.error**2, np.inf)

    def of(self, rows: IntArray) -> PhotoRays:
        """Return some of the rays."""
        return PhotoRays(self.centres[rows], self.rotations[rows], self.vectors[rows], self.error[rows])


def where_most_rays_meet(rays: PhotoRays, point: IntArray, start: FloatArray, limit: float) -> FloatArray:
    """Return positions of points where most of their rays meet.

    Parameters
    ----------
    point : array (n,) of int
        Of each ray.
    start : array (q, 3)
        Where the points are; NaN where not known.
    limit : float
        Standard residual up to which a ray fits the intersection of all right rays. The others miss the intersection of
        two rays by more: by up to twice that they fit, and larger residuals count the same.

    Returns
    -------
    array (q, 3)
        Points stay where as many rays fit, or nearly so, and those with fewer than three rays or more than ten.
    """
    found = start.copy()
    order = np.argsort(point, kind="stable")
    points, first, counts = np.unique(point[order], return_index=True, return_counts=True)
    for count in np.unique(counts):
        if _FEWEST_RAYS <= count <= _MOST_RAYS:
            alike = counts == count
            rows = order[first[alike][:, None] + np.arange(count)]
            found[points[alike]] = _best_positions(rays, rows, start[points[alike]], OF_TWO * limit)
    return found


def _best_positions(rays: PhotoRays, rows: IntArray, start: FloatArray, limit: float) -> FloatArray:
    """Return the positions (q, 3) of least cost of points with rays (q, k); the start where none is clearly better."""
    best, least = start, _costs(rays, rows, start, limit) - 0.5 * limit**2
    for pair in combinations(range(rows.shape[1]), 2):
        tried = _meeting(rays, rows, _of_pair(rows, pair))
        costs = _costs(rays, rows, tried, limit)
        better = costs < least
        best, least = np.where(better[:, None], tried, best), np.where(better, costs, least)
    moved = np.flatnonzero((best != start).any(axis=1))
    # all that fit tell the position better than the two
    tried = _meeting(rays, rows[moved], _squares(rays, rows[moved], best[moved]) <= limit**2)
    better = _costs(rays, rows[moved], tried, limit) < least[moved]
    best = best.copy()
    best[moved[better]] = tried[better]
    return best


def rival_positions(rays: PhotoRays, rows: IntArray, fitting: BoolArray, limit: float) -> FloatArray:
    """Return where most of the rays of points meet, one at least of those that do not fit where the points are.

    Parameters
    ----------
    rows : array (q, k) of int
        The rays of each point.
    fitting : array (q, k) of bool
        Those that fit.
    limit : float
        As in `where_most_rays_meet`.

    Returns
    -------
    array (q, 3)
        NaN where no two of such rays meet.
    """
    best, least = np.full((len(rows), 3), np.nan), np.full(len(rows), np.inf)
    for pair in combinations(range(rows.shape[1]), 2):
        tried = _meeting(rays, rows, _of_pair(rows, pair))
        costs = _costs(rays, rows, tried, OF_TWO * limit)
        better = (costs < least) & ~fitting[:, pair].all(axis=1) & np.isfinite(tried).all(axis=1)
        best, least = np.where(better[:, None], tried, best), np.where(better, costs, least)
    return best


def _of_pair(rows: IntArray, pair: tuple[int, int]) -> BoolArray:
    chosen = np.zeros(rows.shape, dtype=bool)
    chosen[:, pair] = True
    return chosen


def _meeting(rays: PhotoRays, rows: IntArray, chosen: BoolArray) -> FloatArray:
    """Return where the chosen ones (q, k) of the rays (q, k) of points meet, array (q, 3); NaN where they do not."""
    some = rays.of(rows[chosen])
    directions = (some.rotations @ some.vectors[:, :, None])[:, :, 0]
    return intersect_rays(some.centres, directions, np.nonzero(chosen)[0], len(rows))


def _costs(rays: PhotoRays, rows: IntArray, positions: FloatArray, limit: float) -> FloatArray:
    """Return the sums (q,) of squared standard residuals, none larger than that of the limit."""
    return np.asarray(np.fmin(_squares(rays, rows, positions), limit**2).sum(axis=1))


def _squares(rays: PhotoRays, rows: IntArray, positions: FloatArray) -> FloatArray:
    """Return the squared standard residuals (q, k) of positions (q, 3)."""
    return rays.of(rows.ravel()).squares(np.repeat(positions, rows.shape[1], axis=0)).reshape(rows.shape)
