"""Points moved along their corrections: linearly in direction and inverse distance, not in their coordinates.

Photo coordinates are nearly linear in the inverse distance of a point from the photos that show it (Montiel, Civera,
Davison 2006), and far from linear in its distance: by corrections of its coordinates a point gets to infinity slowly,
and one that should come much nearer goes through the photos. Both ways are the same to first order, so that the
correction is that of the coordinates.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from orip.arrays import FloatArray
from orip.bundle.state import State

_FARTHEST = 10.0
"""Times its distance to which a point may go at once."""


def with_points_moved(state: State, move: FloatArray, centres: FloatArray, point: NDArray[np.int64]) -> State:
    """Return the state with its points moved.

    Parameters
    ----------
    state : State
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
