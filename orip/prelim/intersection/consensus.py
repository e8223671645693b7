"""Points placed where most of their rays meet, whatever part of the rays is wrong.

Positions are tried from each two rays of a point, as in random sample consensus (Fischler and Bolles 1981): half of the
rays of a point may be wrong where a block has many outliers, and weights of residuals then settle anywhere.
"""

from __future__ import annotations

from itertools import combinations

import numpy as np

from orip.adjustment.weights import LIMIT_OF_TWO_COMPONENTS
from orip.arrays import BoolArray, FloatArray, IntArray
from orip.geometry.rays import intersect_rays
from orip.prelim.rays.image_rays import ImageRays

_FEWEST_RAYS, _MOST_RAYS = 3, 10
"""Rays of a point: of two neither can be called wrong; of many the right ones outweigh the others."""


def where_most_rays_meet(
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
        Points stay where as many rays fit, or nearly so.
    """
    coordinates = start.copy()
    rows = np.flatnonzero(doubtful[rays.point] & np.isfinite(centres[rays.photo, 0]))
    rows = rows[np.argsort(rays.point[rows], kind="stable")]
    points, first, counts = np.unique(rays.point[rows], return_index=True, return_counts=True)
    for count in np.unique(counts):
        if _FEWEST_RAYS <= count <= _MOST_RAYS:
            alike = counts == count
            of_points = rows[first[alike][:, None] + np.arange(count)]
            origins, vectors = centres[rays.photo[of_points]], rays.vectors[of_points]
            turned = rotations[rays.photo[of_points]]
            seen = _SeenPoints(origins, turned, vectors, scale * rays.error[of_points])
            coordinates[points[alike]] = seen.best_positions(start[points[alike]])
    return coordinates


class _SeenPoints:
    """q points of k rays each: projection centres and image vectors (q, k, 3), rotations (q, k, 3, 3), errors (q, k)."""

    def __init__(self, origins: FloatArray, rotations: FloatArray, vectors: FloatArray, error: FloatArray) -> None:
        self._origins, self._rotations, self._vectors, self._error = origins, rotations, vectors, error
        self._directions = (rotations @ vectors[..., None])[..., 0]

    def best_positions(self, start: FloatArray) -> FloatArray:
        """Return the positions (q, 3) of least cost, the start where none is clearly better."""
        squares = self._squares(start)
        best, least = start, squares.sum(axis=1) - 0.5 * LIMIT_OF_TWO_COMPONENTS**2
        for first, second in combinations(range(self._origins.shape[1]), 2):
            tried = self._met(np.array([first, second]))
            squares = self._squares(tried)
            better = squares.sum(axis=1) < least
            best, least = np.where(better[:, None], tried, best), np.where(better, squares.sum(axis=1), least)
        return best

    def _met(self, which: IntArray) -> FloatArray:
        """Return where some of the rays meet, positions (q, 3)."""
        points = np.repeat(np.arange(len(self._origins)), len(which))
        origins, directions = (part[:, which].reshape(-1, 3) for part in (self._origins, self._directions))
        return intersect_rays(origins, directions, points, len(self._origins))

    def _squares(self, positions: FloatArray) -> FloatArray:
        """Return squared standard residuals (q, k), none above the limit for blunders."""
        u = np.einsum("qki,qkij->qkj", positions[:, None] - self._origins, self._rotations)
        with np.errstate(divide="ignore", invalid="ignore"):
            image = u[..., :2] * (self._vectors[..., 2] / u[..., 2])[..., None]
            squares = ((image - self._vectors[..., :2]) ** 2).sum(axis=2) / self._error**2
        limit = LIMIT_OF_TWO_COMPONENTS**2
        return np.where((u[..., 2] < 0.0) & (squares < limit), squares, limit)
