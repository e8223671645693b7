"""Moving points in other ways than by corrections of their coordinates.

Where a step of the iterations has failed, points are intersected from the rays of the photos, or moved along their
corrections in direction and inverse distance. Photo coordinates are nearly linear in the inverse distance of a point
from the photos that show it (Montiel, Civera, Davison 2006), and far from linear in its distance: by corrections of its
coordinates a point goes to infinity slowly, and one that should come much nearer passes through the photos. Both ways
are the same to first order, so that the correction is that of the coordinates.

Where weights are steady, points are moved to where more of their rays fit. A point that a gross error has pulled away
lowers the weight of its correct rays and stays with the wrong ones. Whether that happens depends on the start;
the position that most of its rays agree on does not.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from orip.adjustment.equations import Equations
from orip.arrays import FloatArray, IntArray
from orip.bundle.kinds.photo_point import POINT_PARTIALS, PhotoPointObservations
from orip.bundle.state import BlockState
from orip.bundle.unknowns import CONSTANT, Unknowns
from orip.geometry.rays import intersect_rays, without_near_points
from orip.interior.image_vectors import image_vectors
from orip.records.block import Block

_FARTHEST = 10.0
"""A point moves to ten times its distance at most."""

_FEWEST_RAYS, _MOST_RAYS = 3, 10
"""Numbers of rays for which a consensus is sought: of two, neither can be called wrong; many outweigh a wrong one."""


def with_intersected_points(block: Block, state: BlockState, unknowns: Unknowns) -> BlockState:
    """Return a state with the points that photos alone determine at the intersection of their rays.

    The cameras are those that the block starts with: this is for states that are far from the solution.
    """
    points = block.photo_points
    directions = (state.rotations[points.photo] @ image_vectors(block)[:, :, None])[:, :, 0]
    seen = points.used.all(axis=1) & np.isfinite(directions).all(axis=1)
    found = intersect_rays(
        state.centres[points.photo[seen]], directions[seen], points.point[seen], len(block.point_names)
    )
    distances = np.linalg.norm(state.points[points.point] - state.centres[points.photo], axis=1)
    found = without_near_points(
        found, state.centres[points.photo[seen]], points.point[seen], float(np.median(distances))
    )
    observed = {point.name for point in block.control_points}
    observed |= {element.name for element in block.elements if element.group == "POINT"}
    free = (unknowns.points >= unknowns.layout.reduced).all(axis=1) & (unknowns.points != CONSTANT).all(axis=1)
    free &= np.array([name not in observed for name in block.point_names], dtype=bool)
    free &= np.isfinite(found).all(axis=1)
    return replace(state, points=np.where(free[:, None], found, state.points))


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


def moves_to_consensus(
    observations: PhotoPointObservations,
    first: int,
    columns: IntArray,
    equations: Equations,
    state: BlockState,
    limit: float,
) -> FloatArray:
    """Return corrections that move points to where more of their rays fit.

    Parameters
    ----------
    observations : PhotoPointObservations
    first : int
        Row of their first equation.
    columns : array (number of points, 3)
        Unknowns of the points.
    equations : Equations
        At the state.
    state : BlockState
    limit : float
        Standard residual up to which a component fits.

    Returns
    -------
    array (m + 3 b,)
        Zero for all unknowns but those of the points that are moved.
    """
    correction = np.zeros(int(columns.max(initial=CONSTANT)) + 1)
    rows = first + 2 * np.arange(len(observations.point))[:, None] + np.arange(2)
    used = equations.active[rows].all(axis=1)
    doubtful = np.zeros(len(columns), dtype=bool)
    doubtful[observations.point[used & (np.abs(equations.residual[rows]) > limit).any(axis=1)]] = True
    doubtful &= (columns != CONSTANT).all(axis=1)
    chosen = used & doubtful[observations.point]
    if not chosen.any():
        return correction
    some = observations.of(chosen)
    design = some.linearise_with_partials(state).partials[:, POINT_PARTIALS] / some.rows.error[:, None]
    residual = equations.residual[rows[chosen]]
    for point in np.unique(some.point):
        mine = some.point == point
        if _FEWEST_RAYS <= np.count_nonzero(mine) <= _MOST_RAYS:
            move = _move(design.reshape(-1, 2, 3)[mine], residual[mine], limit)
            if move is not None:
                correction[columns[point]] = move
    return correction


def _move(design: FloatArray, residual: FloatArray, limit: float) -> FloatArray | None:
    """Return the move (3,) to the position that most of n rays agree on; None if it already exists.

    `design` (n, 2, 3) and `residual` (n, 2) are in units of the a-priori errors.
    """
    best: tuple[int, float] = (_fitting(residual, limit), np.inf)
    found = None
    for pair in combinations(range(len(residual)), 2):
        chosen = list(pair)
        move, *_ = np.linalg.lstsq(design[chosen].reshape(4, 3), -residual[chosen].ravel(), rcond=None)
        there = residual + design @ move
        count = _fitting(there, limit)
        cost = float(np.minimum(there**2, limit**2).sum())
        if count > best[0] or (found is not None and count == best[0] and cost < best[1]):
            best, found = (count, cost), np.asarray(move, dtype=np.float64)
    return found


def _fitting(residual: FloatArray, limit: float) -> int:
    return int(np.count_nonzero((np.abs(residual) <= limit).all(axis=1)))
