"""Points placed where most of their rays agree, and moved otherwise than by corrections of their coordinates."""

from __future__ import annotations

from collections.abc import Callable
from collections.abc import Set as AbstractSet
from itertools import combinations
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from orip.adjustment.equations import Equations
from orip.adjustment.weights import LIMIT_OF_TWO_COMPONENTS, danish_weights
from orip.arrays import BoolArray, FloatArray, IntArray
from orip.bundle.kinds.photo_point import POINT_PARTIALS, PhotoPointObservations
from orip.bundle.state import BlockState, poses_of_rays
from orip.bundle.unknowns import CONSTANT, Unknowns
from orip.geometry.rays import PhotoRays, intersect_rays, points_at_origins, where_most_rays_meet
from orip.interior.image_coordinates import image_vectors
from orip.records.block import Block, IndexedPhotoPoints
from orip.structs import replace

# A point that a gross error has pulled away takes the weight of its correct rays and stays with the wrong ones; whether
# that happens depends on the starting values, and which position most of its rays agree on does not. As in random
# sample consensus (Fischler and Bolles 1981) positions are tried, here from each two rays of a point, photos held.

_FEWEST_RAYS, _MOST_RAYS = 3, 10
"""Rays of a point whose consensus is looked for: of two, neither can be called wrong; many outweigh a wrong one."""

_LITTLE = 1e-9
"""Part of the trace of normal equations that keeps them regular where rays are parallel."""

_MOST_REWEIGHTINGS = 50
_STEADY = 1e-4
"""Change of a residual, in a-priori errors, below which weights are steady: that of the convergence of a block."""

_LEFT_OUT = 1e-6
"""Weight factor of rays that do not fit, where a position is computed from the others."""


class PointRays(NamedTuple):
    """q points of k rays each, photos held: partials (q, 2 k, 3) and residuals (q, 2 k) in a-priori errors."""

    partials: FloatArray
    residuals: FloatArray

    def after(self, moves: FloatArray) -> FloatArray:
        """Return the residuals (q, 2 k) after moves (q, 3) of the points."""
        return np.asarray(self.residuals + (self.partials @ moves[:, :, None])[:, :, 0])

    def of_pair(self, first: int, second: int) -> PointRays:
        """Return two of the rays of each point."""
        rows = [2 * first, 2 * first + 1, 2 * second, 2 * second + 1]
        return PointRays(self.partials[:, rows], self.residuals[:, rows])

    def least_squares(self, weights: FloatArray | float = 1.0) -> FloatArray:
        """Return the moves (q, 3) to the positions of least squares, with weights (q, 2 k)."""
        weighted = self.partials * np.broadcast_to(weights, self.residuals.shape)[:, :, None]
        normals = np.swapaxes(weighted, 1, 2) @ self.partials
        right = -(np.swapaxes(weighted, 1, 2) @ self.residuals[:, :, None])
        trace = np.einsum("qii->q", normals)
        regular = normals + (_LITTLE * trace + (trace == 0.0))[:, None, None] * np.eye(3)
        return np.asarray(np.linalg.solve(regular, right)[:, :, 0])


Moves = Callable[[PointRays, float], FloatArray]
"""What moves points, from their rays and the limit up to which a residual fits."""


def placed(rays: PointRays, limit: float) -> FloatArray:
    """Return the moves (q, 3) to where most rays agree; of least squares where no ray can be called wrong.

    They do not depend on where the points are, as far as the perspective is linear.
    """
    moves = rays.least_squares()
    found, costs = _consensus(rays, limit)
    better = costs < _costs(rays.after(moves), limit)
    return np.where(better[:, None], found, moves)


def where_better(rays: PointRays, limit: float) -> FloatArray:
    """Return the moves (q, 3) to where most rays agree, zero for points that fit as well where they are."""
    found, costs = _consensus(rays, limit)
    # a position that fits as many rays, and a little better, is left to the iterations
    better = costs < _costs(rays.residuals, limit) - limit**2 / 2.0
    return np.where(better[:, None], found, 0.0)


def with_steady_weights(rays: PointRays, limit: float) -> FloatArray:
    """Return the moves (q, 3) after which the Danish weights of the rays, each as a whole, no longer change.

    They lower the robust cost of the points, photos held (Holland and Welsch 1977).
    """
    moves, going_on = np.zeros((len(rays.residuals), 3)), np.arange(len(rays.residuals))
    for _ in range(_MOST_REWEIGHTINGS):
        some = PointRays(rays.partials[going_on], rays.residuals[going_on])
        here = some.after(moves[going_on])
        lengths = np.sqrt((here**2).reshape(len(here), -1, 2).sum(axis=2))
        moves[going_on] = some.least_squares(np.repeat(danish_weights(lengths, limit), 2, axis=1))
        going_on = going_on[np.abs(some.after(moves[going_on]) - here).max(axis=1, initial=0.0) > _STEADY]
        if not len(going_on):
            break
    return moves


def _consensus(rays: PointRays, limit: float) -> tuple[FloatArray, FloatArray]:
    """Return the moves (q, 3) of least cost among those from each two rays, and their costs (q,)."""
    best, least = np.zeros((len(rays.residuals), 3)), np.full(len(rays.residuals), np.inf)
    count = rays.residuals.shape[1] // 2
    if not _FEWEST_RAYS <= count <= _MOST_RAYS:
        return best, least
    for first, second in combinations(range(count), 2):
        moves = rays.of_pair(first, second).least_squares()
        fitting = np.where(np.abs(rays.after(moves)) <= limit, 1.0, _LEFT_OUT)
        for tried in (moves, rays.least_squares(fitting)):
            costs = _costs(rays.after(tried), limit)
            better = costs < least
            best, least = np.where(better[:, None], tried, best), np.where(better, costs, least)
    return best, least


def _costs(residuals: FloatArray, limit: float) -> FloatArray:
    """Return the costs (q,) of residuals (q, 2 k): a ray is wrong as a whole, whichever of its components shows it."""
    squares = (residuals**2).reshape(len(residuals), -1, 2).sum(axis=2)
    return np.asarray(np.minimum(squares, limit**2).sum(axis=1))


def with_consensus(block: Block, state: BlockState, wanted: BoolArray) -> BlockState:
    """Return the state with the wanted points (number of points,) where most of their rays meet, photos held.

    Nothing is linearised: the points may be anywhere.
    """
    rays, point = rays_of_points(block, state, wanted)
    return replace(state, points=where_most_rays_meet(rays, point, state.points, LIMIT_OF_TWO_COMPONENTS))


def rays_of_points(block: Block, state: BlockState, wanted: BoolArray) -> tuple[PhotoRays, IntArray]:
    """Return the rays of the wanted points that are measured in full, and the point of each."""
    points, vectors = block.photo_points, image_vectors(block)
    rows = np.flatnonzero(wanted[points.point] & points.in_use & np.isfinite(vectors).all(axis=1))
    error, at = np.sqrt(np.mean(points.error[rows] ** 2, axis=1)), poses_of_rays(block, state, rows)
    return PhotoRays(at.centres, at.rotations, vectors[rows], error), points.point[rows]


def moves_of_points(
    observations: PhotoPointObservations,
    unknowns: Unknowns,
    equations: Equations,
    state: BlockState,
    limit: float,
    moves: Moves,
) -> FloatArray:
    """Return corrections that move the points of which an observation does not fit.

    Parameters
    ----------
    observations : PhotoPointObservations
        All photo points of the block, whose equations are the first ones.
    equations : Equations
        At the state.
    limit : float
        Standard residual up to which a component fits.
    moves : callable
        `placed` or `where_better`.

    Returns
    -------
    array (m + 3 b,)
        Zero for all unknowns but those of the points that are moved.
    """
    correction, columns = np.zeros(unknowns.layout.size), unknowns.points
    rows = 2 * np.arange(len(observations.point))[:, None] + np.arange(2)
    used = equations.active[rows].all(axis=1)
    doubtful = np.zeros(len(columns), dtype=bool)
    doubtful[observations.point[used & (np.abs(equations.residual[rows]) > limit).any(axis=1)]] = True
    doubtful &= (columns != CONSTANT).all(axis=1)
    chosen = used & doubtful[observations.point]
    if not chosen.any():
        return correction
    some = observations.of(chosen)
    partials = some.linearise_with_partials(state).partials[:, POINT_PARTIALS] / some.rows.error[:, None]
    partials, residuals = partials.reshape(-1, 2, 3), equations.residual[rows[chosen]]
    order = np.argsort(some.point, kind="stable")
    points, starts, counts = np.unique(some.point[order], return_index=True, return_counts=True)
    for count in np.unique(counts[counts > 1]):
        alike = np.flatnonzero(counts == count)
        places = order[starts[alike][:, None] + np.arange(count)]
        rays = PointRays(
            partials[places].reshape(len(alike), 2 * count, 3), residuals[places].reshape(len(alike), 2 * count)
        )
        correction[columns[points[alike]]] = moves(rays, limit)
    return correction


# Where a step of the iterations has failed, points are intersected from the rays of the photos, or moved along their
# corrections in direction and inverse distance. Photo coordinates are nearly linear in the inverse distance of a point
# from the photos that show it (Montiel, Civera, Davison 2006), and far from linear in its distance: by corrections of
# its coordinates a point goes to infinity slowly, and one that should come much nearer passes through the photos. Both
# ways are the same to first order, so that the correction is that of the coordinates.

_NEAR = 0.5
"""Part of its distance from a photo that a point keeps: beside a projection centre it fits any ray of that photo."""

_FARTHEST = 10.0
"""A point moves to ten times its distance at most."""


def with_intersected_points(block: Block, state: BlockState, unknowns: Unknowns) -> BlockState:
    """Return a state with the points that photos alone determine at the intersection of their rays.

    The cameras are those that the block starts with: this is for states that are far from the solution.
    """
    points = block.photo_points
    at = poses_of_rays(block, state, slice(None))
    directions = (at.rotations @ image_vectors(block)[:, :, None])[:, :, 0]
    seen = points.in_use & np.isfinite(directions).all(axis=1)
    found = intersect_rays(at.centres[seen], directions[seen], points.point[seen], len(block.point_names))
    distances = np.linalg.norm(state.points[points.point] - state.centres[points.photo], axis=1)
    found[points_at_origins(found, at.centres[seen], points.point[seen], float(np.median(distances)))] = np.nan
    free = points_by_photos_alone(block, unknowns) & np.isfinite(found).all(axis=1)
    return replace(state, points=np.where(free[:, None], found, state.points))


def points_by_photos_alone(block: Block, unknowns: Unknowns) -> BoolArray:
    """Return which points (number of points,) are eliminated unknowns that nothing but photo points observes."""
    control = {point.name for point in block.control_points}
    return points_by_photos_and_control(block, unknowns) & ~_are_named(block, control)


def points_by_photos_and_control(block: Block, unknowns: Unknowns) -> BoolArray:
    """Return those (number of points,) that may be control points, too."""
    elements = {element.name for element in block.elements if element.group == "POINT"}
    elements |= {point.point for point in block.figure_points} | {one.point for one in block.terrain_heights}
    free = (unknowns.points >= unknowns.layout.reduced).all(axis=1) & (unknowns.points != CONSTANT).all(axis=1)
    return np.asarray(free & ~_are_named(block, elements))


def _are_named(block: Block, names: AbstractSet[str]) -> BoolArray:
    return np.array([name in names for name in block.point_names], dtype=bool)


def with_points_moved(state: BlockState, move: FloatArray, centres: FloatArray, point: NDArray[np.int64]) -> BlockState:
    """Return the state with its points moved.

    Parameters
    ----------
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
