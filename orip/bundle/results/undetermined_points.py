"""Points that their rays do not determine, as a whole or in some coordinates.

A coordinate that is removed, such as the depth of a point with one ray, is a guess; so are the others, which follow
from it along the ray. And where rays meet at an angle that is not significantly different from zero, a distance from
the photos is computed, but it means nothing, nor does its standard deviation: any other one fits the same observations.
"""

from __future__ import annotations

import numpy as np

from orip.arrays import BoolArray, FloatArray, IntArray
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
    rays, direction = _rays(solved)
    distance = np.linalg.norm(direction, axis=1)
    point = solved.block.photo_points.point[rays]
    of_found = found.any(axis=1)[point]
    along = np.zeros_like(found)
    np.logical_or.at(along, point[of_found], np.abs(direction[of_found]) > _ALONG * distance[of_found, None])
    found |= unknown & along & found.any(axis=1, keepdims=True)
    doubtful = _doubtful(solved, cofactors, point, distance) & ~found.any(axis=1)
    mine = doubtful[point]
    if mine.any():
        significant = _significance(solved, cofactors[point[mine]], direction[mine]) >= _LEAST_SIGNIFICANCE
        doubtful[point[mine][significant]] = False
        found[doubtful] = unknown[doubtful]
    return np.asarray(found)


def _rays(solved: SolvedBlock) -> tuple[IntArray, FloatArray]:
    """Return the photo points (k,) that take part, and where their points are from the projection centres (k, 3)."""
    points, state = solved.block.photo_points, solved.state
    taking_part = solved.weight_factors[: 2 * len(points.point)].reshape(-1, 2).any(axis=1)
    rays = np.flatnonzero(taking_part)
    return rays, state.points[points.point[rays]] - state.centres[points.photo[rays]]


def _doubtful(solved: SolvedBlock, cofactors: FloatArray, point: IntArray, distance: FloatArray) -> BoolArray:
    """Return the points that may be too near to a photo for their precision, by a bound that is quick to compute."""
    nearest = np.full(len(solved.block.point_names), np.inf)
    np.minimum.at(nearest, point, distance)
    size = solved.deviation_scale * np.sqrt(np.maximum(np.einsum("nii->n", cofactors), 0.0))
    return np.asarray(nearest < _LEAST_SIGNIFICANCE * size)


def _significance(solved: SolvedBlock, cofactors: FloatArray, direction: FloatArray) -> FloatArray:
    """Return the lengths of rays (k,) in standard deviations of their points along them."""
    squares = np.einsum("ni,ni->n", direction, direction)
    variance = np.einsum("ni,nij,nj->n", direction, cofactors, direction)
    with np.errstate(divide="ignore", invalid="ignore"):  # a point at a projection centre has no direction
        lengths = squares / (solved.deviation_scale * np.sqrt(np.maximum(variance, 0.0)))
    return np.asarray(np.nan_to_num(lengths, nan=0.0))
