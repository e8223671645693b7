"""Points where most of their rays meet, also those that were left out: of many rays half may be wrong."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from orip.adjustment.weights import LIMIT_OF_TWO_COMPONENTS
from orip.arrays import BoolArray, IntArray
from orip.bundle.left_out_points import determined_points
from orip.bundle.point_moves import points_by_photos_alone
from orip.bundle.state import BlockState
from orip.bundle.unknowns import Unknowns
from orip.geometry.ray_consensus import PhotoRays, where_most_rays_meet
from orip.interior.image_vectors import image_vectors
from orip.records.block import Block

_AGREEING = 3
"""Rays that meet at a point: two do so wherever one of them is wrong along the epipolar line."""


def with_points_where_most_rays_meet(block: Block, state: BlockState, wanted: BoolArray) -> BlockState:
    """Return the state with the wanted points (number of points,) where most of their rays meet, photos held."""
    rays, point = _rays(block, state, wanted)
    return replace(state, points=where_most_rays_meet(rays, point, state.points, LIMIT_OF_TWO_COMPONENTS))


def with_doubtful_points_placed(block: Block, unknowns: Unknowns, state: BlockState, fits: BoolArray) -> BlockState:
    """Return the state with the points of photos alone that do not fit where most of their rays meet, photos held."""
    return with_points_where_most_rays_meet(block, state, points_by_photos_alone(block, unknowns) & ~fits)


def points_still_out(block: Block, state: BlockState, left_out: BoolArray, fits: BoolArray) -> BoolArray:
    """Return which points (number of points,) stay left out: neither do all rays meet at them, nor most of several.

    `fits` (number of points,) are the points all of whose rays fit.
    """
    rays, point = _rays(block, state, left_out)
    met = rays.squares(state.points[point]) <= LIMIT_OF_TWO_COMPONENTS**2
    number, agreeing = (np.bincount(point, part, len(fits)) for part in (None, met))
    some = left_out & (fits | ((agreeing >= _AGREEING) & (2 * agreeing >= number)))
    return np.asarray(left_out & ~determined_points(block, state, some))


def _rays(block: Block, state: BlockState, wanted: BoolArray) -> tuple[PhotoRays, IntArray]:
    """Return the rays of the wanted points that are measured in full, and the point of each."""
    points, vectors = block.photo_points, image_vectors(block)
    rows = np.flatnonzero(wanted[points.point] & points.used.all(axis=1) & np.isfinite(vectors).all(axis=1))
    photo, error = points.photo[rows], np.sqrt(np.mean(points.error[rows] ** 2, axis=1))
    return PhotoRays(state.centres[photo], state.rotations[photo], vectors[rows], error), points.point[rows]
