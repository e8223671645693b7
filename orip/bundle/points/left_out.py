"""Points whose rays have no angle of intersection: they are left out of the adjustment.

The distance of such a point is anything up to infinity. Its corrections grow from iteration to iteration, and the
standard deviations of what little they determine say nothing of where it is.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from orip.adjustment.factorisation.elimination import BlockFactors
from orip.adjustment.weights import LIMIT_OF_TWO_COMPONENTS
from orip.arrays import BoolArray, FloatArray, IntArray
from orip.bundle.points.consensus import points_by_photos_alone, rays_of_points, with_consensus
from orip.bundle.state import BlockState, poses_of_rays
from orip.bundle.unknowns import Unknowns
from orip.geometry.projection import PROJECTIONS
from orip.geometry.rays import intersect_rays
from orip.interior.image_coordinates import image_vectors
from orip.records.block import Block
from orip.structs import replace

_DETERMINED = 0.5
"""Standard deviation of the distance of a point, as a part of the distance, up to which it is determined."""

_LEAST_RAYS = 2

_AGREEING = 3
"""Rays that meet at a point to which others do not belong: two do so wherever one is wrong along the epipolar line."""

LEAST_WEIGHT_OF_FIT = 0.01
"""Weight factor from which a ray may still fit while the weights settle: its residual is less than five limits."""


def without_undetermined_points(
    block: Block, state: BlockState, unknowns: Unknowns, factors: BlockFactors, scale: float
) -> BlockState | None:
    """Return a state in which points without an angle of intersection are left out; None if there are none.

    Points that lie behind the photos, though their rays meet in front of them, are placed there.

    Parameters
    ----------
    factors : BlockFactors
        Of the normal equations at the state: they tell at no cost which points are worth a look.
    scale : float
        Errors of the photo points, in a-priori errors.
    """
    suspects = _suspects(block, state, unknowns, factors, scale)
    if not suspects.any():
        return None
    rays = _with_rays_of(block, suspects)
    meeting, at_an_angle = _intersections(rays, state, scale)
    left_out = suspects & ~(at_an_angle & (_in_front(rays, state, meeting) >= _LEAST_RAYS))
    moved = suspects & ~left_out & (_in_front(rays, state, state.points) < _LEAST_RAYS)
    if not (left_out | moved).any():
        return None
    points = np.where(moved[:, None], meeting, state.points)
    return replace(state, points=points, left_out=state.left_out | left_out)


def without_contradictory_points(
    block: Block, state: BlockState, unknowns: Unknowns, factors: BlockFactors, scale: float, fitting: IntArray
) -> BlockState | None:
    """Return a state without points that only down-weighted rays determine; None if there are none.

    The parameters are those of `without_undetermined_points`; the weights of the normal equations are final ones.
    `fitting` (number of points,) is the number of rays of each point that fit: a point beside a projection centre is
    determined by rays of any weight.
    """
    alone = points_by_photos_alone(block, unknowns) & ~state.left_out & (fitting < _LEAST_RAYS)
    several = np.bincount(block.photo_points.point[block.photo_points.partly_in_use], minlength=len(fitting))
    suspects = _suspects(block, state, unknowns, factors, scale) | (alone & (several >= _LEAST_RAYS))
    return replace(state, left_out=state.left_out | suspects) if suspects.any() else None


def without_contradicting_pairs(block: Block, state: BlockState, unknowns: Unknowns, fits: BoolArray) -> BlockState:
    """Return a state without points that do not fit and have two rays: of these, neither can be called wrong.

    `fits` (number of points,) are the points that fit where the sum of squares of their residuals is least.
    """
    rays = block.photo_points
    number = np.bincount(rays.point[rays.partly_in_use], minlength=len(fits))
    pairs = points_by_photos_alone(block, unknowns) & (number == _LEAST_RAYS) & ~fits
    return replace(state, left_out=state.left_out | pairs)


def _determined_points(block: Block, state: BlockState, wanted: BoolArray) -> BoolArray:
    """Return which of the wanted points (number of points,) have an angle of intersection."""
    if not wanted.any():
        return wanted
    rays = _with_rays_of(block, wanted)
    _, at_an_angle = _intersections(rays, state, 1.0)
    return np.asarray(wanted & at_an_angle)


def improved_points(
    block: Block,
    unknowns: Unknowns,
    state: BlockState,
    everywhere: BlockState,
    fitting: Callable[[BlockState], BoolArray],
) -> BlockState | None:
    """Return a state with points where most of their rays meet, and fewer left out; None if it is the given one.

    Parameters
    ----------
    everywhere : BlockState
        The state without points that are left out; some points may have been moved.
    fitting : callable
        Gives the points (number of points,) of a state all of whose rays fit.
    """
    doubtful = points_by_photos_alone(block, unknowns) & ~fitting(everywhere)
    more = with_consensus(block, everywhere, doubtful)
    out, kept = _still_out(block, more, state.left_out, fitting(more)), ~state.left_out
    if np.array_equal(out, state.left_out) and np.array_equal(more.points[kept], state.points[kept]):
        return None
    return replace(more, left_out=out)


def _still_out(block: Block, state: BlockState, left_out: BoolArray, fits: BoolArray) -> BoolArray:
    """Return which points (number of points,) stay left out: neither do all rays meet at them, nor most of several."""
    rays, point = rays_of_points(block, state, left_out)
    met = rays.squares(state.points[point]) <= LIMIT_OF_TWO_COMPONENTS**2
    number, agreeing = (np.bincount(point, part, len(fits)) for part in (None, met))
    some = left_out & (fits | ((agreeing >= _AGREEING) & (2 * agreeing >= number)))
    return np.asarray(left_out & ~_determined_points(block, state, some))


def _with_rays_of(block: Block, wanted: BoolArray) -> Block:
    """Return the block with the photo points of some points (number of points,) that are measured in full."""
    rays = block.photo_points
    rows = np.flatnonzero(wanted[rays.point] & rays.in_use)
    return replace(block, photo_points=rays.of(rows))


def _suspects(block: Block, state: BlockState, unknowns: Unknowns, factors: BlockFactors, scale: float) -> BoolArray:
    """Return which points (number of points,) the normal equations determine badly along their rays."""
    rays = block.photo_points
    # of one ray nothing moves a point along it
    several = np.bincount(rays.point[rays.partly_in_use], minlength=len(state.points)) >= _LEAST_RAYS
    by_photos = points_by_photos_alone(block, unknowns) & ~state.left_out & several
    points = np.flatnonzero(by_photos)
    half = factors.half[(unknowns.points[points, 0] - unknowns.layout.reduced) // 3]
    number = np.maximum(np.bincount(rays.point, minlength=len(by_photos)), 1)
    middle = np.stack([np.bincount(rays.point, axis, len(by_photos)) for axis in state.centres[rays.photo].T], axis=1)
    away = state.points[points] - middle[points] / number[points, None]
    squares = np.einsum("ij,ij->i", away, away)
    variances = np.einsum("ijk,ik->ij", half, away)
    relative = scale**2 * np.einsum("ij,ij->i", variances, variances) / np.where(squares > 0.0, squares, 1.0) ** 2
    removed = factors.removed[(unknowns.points[points, 0] - unknowns.layout.reduced) // 3].any(axis=1)
    by_photos[points] = removed | ~(relative <= _DETERMINED**2)
    return by_photos


def _intersections(block: Block, state: BlockState, scale: float) -> tuple[FloatArray, BoolArray]:
    """Return where the rays of points meet, and which of them (number of points,) do so at an angle."""
    rays, vectors, count = block.photo_points, image_vectors(block), len(state.points)
    rows = np.flatnonzero(np.isfinite(vectors).all(axis=1))
    at, point, lengths = poses_of_rays(block, state, rows), rays.point[rows], np.linalg.norm(vectors[rows], axis=1)
    directions = (at.rotations @ (vectors[rows] / lengths[:, None])[:, :, None])[:, :, 0]
    meeting = intersect_rays(at.centres, directions, point, count)
    # in units of its own error a direction tells how well a distance is known
    precision = lengths / (scale * np.sqrt(np.mean(rays.error[rows] ** 2, axis=1)))
    normals = np.zeros((count, 3, 3))
    np.add.at(
        normals, point, precision[:, None, None] ** 2 * (np.eye(3) - directions[:, :, None] * directions[:, None])
    )
    return meeting, np.asarray(np.linalg.eigvalsh(normals)[:, 0] * _DETERMINED**2 >= 1.0)


def _in_front(block: Block, state: BlockState, points: FloatArray) -> IntArray:
    """Return how many photos have each of the points (number of points, 3) in front of them."""
    rays = block.photo_points
    u = np.einsum("ij,ijk->ki", points[rays.point] - state.centres[rays.photo], state.rotations[rays.photo])
    in_front = u[2] < 0.0
    equidistant = np.array([camera.projection == "equidistant" for camera in block.cameras])
    if equidistant.any():
        rows = equidistant[block.photo_camera[rays.photo]]
        in_front[rows] = PROJECTIONS["equidistant"].is_in_front(*u[:, rows])
    return np.bincount(rays.point[in_front], minlength=len(points))
