"""Points that the Danish method has left to the wrong rays, and where most of their rays would have them.

A point that a gross error has pulled away takes the weight of its good rays, and keeps to the wrong ones. Whether that
happens depends on where the iterations began. What most of its rays agree on does not.
"""

from __future__ import annotations

from itertools import combinations

import numpy as np

from orip.adjustment.equations import Equations
from orip.arrays import FloatArray, IntArray
from orip.bundle.kinds.photo_point import POINT_PARTIALS, PhotoPointObservations
from orip.bundle.state import State
from orip.bundle.unknowns import CONSTANT

_FEWEST, _MOST = 3, 10
"""Rays of a point that is looked at: with two none can be called wrong, with many none takes over."""


def moves_to_consensus(
    observations: PhotoPointObservations,
    first: int,
    columns: IntArray,
    equations: Equations,
    state: State,
    limit: float,
) -> FloatArray:
    """Return corrections that take points to where more of their rays fit than do now.

    Parameters
    ----------
    observations : PhotoPointObservations
    first : int
        Row of their first equation.
    columns : array (number of points, 3)
        Unknowns of the points.
    equations : Equations
        At the state in hand.
    state : State
    limit : float
        Standard residual up to which a component fits.

    Returns
    -------
    array (m + 3 b,)
        Zero for all that stays; all zero where no point has a better place.
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
        if _FEWEST <= np.count_nonzero(mine) <= _MOST:
            move = _move(design.reshape(-1, 2, 3)[mine], residual[mine], limit)
            if move is not None:
                correction[columns[point]] = move
    return correction


def _move(design: FloatArray, residual: FloatArray, limit: float) -> FloatArray | None:
    """Return the move (3,) to the place that most of n rays agree on; None if that is where the point is.

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
