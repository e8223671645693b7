"""Moving points in other ways than by corrections of their coordinates.

Where a step of the iterations has failed, points are intersected from the rays of the photos, or moved along their
corrections in direction and inverse distance. Photo coordinates are nearly linear in the inverse distance of a point
from the photos that show it (Montiel, Civera, Davison 2006), and far from linear in its distance: by corrections of its
coordinates a point goes to infinity slowly, and one that should come much nearer passes through the photos. Both ways
are the same to first order, so that the correction is that of the coordinates.
"""

from __future__ import annotations

from collections.abc import Set as AbstractSet

import numpy as np
from numpy.typing import NDArray

from orip.arrays import BoolArray, FloatArray
from orip.bundle.state import BlockState
from orip.bundle.unknowns import CONSTANT, Unknowns
from orip.geometry.rays import intersect_rays, points_at_origins
from orip.interior.image_vectors import image_vectors
from orip.records.block import Block, IndexedPhotoPoints
from orip.structs import replace

_NEAR = 0.5
"""Part of its distance from a photo that a point keeps: beside a projection centre it fits any ray of that photo."""

_FARTHEST = 10.0
"""A point moves to ten times its distance at most."""


def with_intersected_points(block: Block, state: BlockState, unknowns: Unknowns) -> BlockState:
    """Return a state with the points that photos alone determine at the intersection of their rays.

    The cameras are those that the block starts with: this is for states that are far from the solution.
    """
    points = block.photo_points
    directions = (state.rotations[points.photo] @ image_vectors(block)[:, :, None])[:, :, 0]
    seen = points.in_use & np.isfinite(directions).all(axis=1)
    found = intersect_rays(
        state.centres[points.photo[seen]], directions[seen], points.point[seen], len(block.point_names)
    )
    distances = np.linalg.norm(state.points[points.point] - state.centres[points.photo], axis=1)
    found[
        points_at_origins(found, state.centres[points.photo[seen]], points.point[seen], float(np.median(distances)))
    ] = np.nan
    free = points_by_photos_alone(block, unknowns) & np.isfinite(found).all(axis=1)
    return replace(state, points=np.where(free[:, None], found, state.points))


def points_by_photos_alone(block: Block, unknowns: Unknowns) -> BoolArray:
    """Return which points (number of points,) are eliminated unknowns that nothing but photo points observes."""
    control = {point.name for point in block.control_points}
    return points_by_photos_and_control(block, unknowns) & ~_are_named(block, control)


def points_by_photos_and_control(block: Block, unknowns: Unknowns) -> BoolArray:
    """Return those (number of points,) that may be control points, too."""
    elements = {element.name for element in block.elements if element.group == "POINT"}
    free = (unknowns.points >= unknowns.layout.reduced).all(axis=1) & (unknowns.points != CONSTANT).all(axis=1)
    return np.asarray(free & ~_are_named(block, elements))


def _are_named(block: Block, names: AbstractSet[str]) -> BoolArray:
    return np.array([name in names for name in block.point_names], dtype=bool)


def with_points_moved(state: BlockState, move: FloatArray, centres: FloatArray, point: NDArray[np.int64]) -> BlockState:
    """Return the state with its points moved.

    Parameters
    ----------
    state : BlockState
    move : array (number of points, 3)
        Corrections of the coordinates.
    centres : array (n, 3)
        Projection centre of each ray.
    point : array (n,)
        Point of each ray.

    Notes
    -----
    With v the vector to the point from the mean of its projection centres, t = move . v / v^2, the point moves by
    move / (1 - t): its inverse distance changes by the part t. Where t is above 0.9 the move is shortened to that.
    """
    count = len(move)
    rays = np.maximum(np.bincount(point, minlength=count), 1)
    middle = np.stack([np.bincount(point, axis, count) for axis in centres.T], axis=1) / rays[:, None]
    away = state.points - middle
    squares = np.einsum("ij,ij->i", away, away)
    nearer = np.einsum("ij,ij->i", move, away) / np.where(squares > 0.0, squares, 1.0)
    most = 1.0 - 1.0 / _FARTHEST
    shorter = most / np.maximum(nearer, most)
    return replace(state, points=state.points + (shorter / (1.0 - shorter * nearer))[:, None] * move)


def come_near(before: BlockState, after: BlockState, rays: IndexedPhotoPoints) -> BoolArray:
    """Return which points (number of points,) come from one state to the other far nearer to a photo of theirs."""
    distances = [
        np.linalg.norm(state.points[rays.point] - state.centres[rays.photo], axis=1) for state in (before, after)
    ]
    nearer = np.zeros(len(before.points), dtype=bool)
    nearer[rays.point[distances[1] < _NEAR * distances[0]]] = True
    return nearer
