"""Points that their rays do not determine, as a whole or in some coordinates.

A coordinate that is removed, such as the depth of a point with one ray, is a guess; so are the others, which follow
from it along the ray. And where rays meet at an angle that is not significantly different from zero, a distance from
the photos is computed, but it means nothing, nor does its standard deviation: any other one fits the same observations.
"""

from __future__ import annotations

import numpy as np

from orip.arrays import BoolArray, FloatArray, IntArray, parts
from orip.bundle.solve import SolvedBlock
from orip.bundle.unknowns import CONSTANT

_ALONG = 1e-6
"""Component of a ray's unit vector above which a coordinate depends on the distance along the ray."""

_LEAST_SIGNIFICANCE = 2.0
"""Distance of a point from a photo, in standard deviations, below which it is not significant at the 5 % level."""


def undetermined_coordinates(solved: SolvedBlock, cofactors: FloatArray) -> BoolArray:
    """Return which local coordinates (number of points, 3) of the points are not determined; constants never.

    Parameters
    ----------
    solved : SolvedBlock
    cofactors : array (number of points, 3, 3)
        Of the local coordinates.
    """
    columns = solved.problem.unknowns.points
    unknown = columns != CONSTANT
    found = unknown & solved.normals.removed[columns]
    of_found = found.any(axis=1)
    along = np.zeros_like(found)
    nearest = np.full(len(found), np.inf)
    for part in parts(len(solved.block.photo_points.photo)):
        point, direction = _rays(solved, part)
        distance = np.sqrt(direction**2 @ np.ones(3))
        np.minimum.at(nearest, point, distance)
        of_part = of_found[point]
        np.logical_or.at(along, point[of_part], np.abs(direction[of_part]) > _ALONG * distance[of_part, None])
    found |= unknown & along & of_found[:, None]
    # the points that may be too near to a photo for their precision, by a bound that is quick to compute
    size = solved.deviation_scale * np.sqrt(np.maximum(np.einsum("nii->n", cofactors), 0.0))
    doubtful = (nearest < _LEAST_SIGNIFICANCE * size) & ~found.any(axis=1)
    if doubtful.any():
        point, direction = _rays(solved, np.flatnonzero(doubtful[solved.block.photo_points.point]))
        significant = _significance(solved, cofactors[point], direction) >= _LEAST_SIGNIFICANCE
        doubtful[point[significant]] = False
        found[doubtful] = unknown[doubtful]
    return np.asarray(found)


def _rays(solved: SolvedBlock, rows: slice | IntArray) -> tuple[IntArray, FloatArray]:
    """Return the points (k,) of those photo points that take part, and where these are from the photos' centres (k, 3).

    `rows` are the photo points to look at.
    """
    points, state = solved.block.photo_points.of(rows), solved.state
    weight_x, weight_y = solved.weight_factors[: 2 * len(solved.block.photo_points.photo)].reshape(-1, 2)[rows].T
    rays = np.flatnonzero((weight_x != 0.0) | (weight_y != 0.0))
    return points.point[rays], state.points[points.point[rays]] - state.centres[points.photo[rays]]


def _significance(solved: SolvedBlock, cofactors: FloatArray, direction: FloatArray) -> FloatArray:
    """Return the lengths of rays (k,) in standard deviations of their points along them."""
    squares = np.einsum("ni,ni->n", direction, direction)
    variance = np.einsum("ni,nij,nj->n", direction, cofactors, direction)
    with np.errstate(divide="ignore", invalid="ignore"):  # a point at a projection centre has no direction
        lengths = squares / (solved.deviation_scale * np.sqrt(np.maximum(variance, 0.0)))
    return np.asarray(np.nan_to_num(lengths, nan=0.0))
