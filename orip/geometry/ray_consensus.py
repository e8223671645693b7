"""Points placed where most of their rays meet, whatever part of the rays is wrong.

Positions are tried from each two rays of a point, as in random sample consensus (Fischler and Bolles 1981): half of the
rays of a point may be wrong where a block has many outliers, and weights of residuals then settle anywhere.
"""

from __future__ import annotations

from itertools import combinations
from typing import NamedTuple

import numpy as np

from orip.arrays import BoolArray, FloatArray, IntArray
from orip.geometry.rays import intersect_rays

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
    rays : PhotoRays
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
    rays : PhotoRays
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
