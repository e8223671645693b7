"""Points put exactly on the lines, planes, cylinders and levels that they lie on, and in the directions given.

What a movement of a whole block changes of the distances of its points from figures, which move with it, is nothing
there. Elsewhere a change of scale changes them, and a turn about a line those to the side and up: as much as they
themselves are, which says nothing of scale and rotation.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from orip.bundle.kinds.figure import FigureObservations
from orip.bundle.kinds.given_direction import GivenDirectionObservations
from orip.bundle.kinds.observation import Observations
from orip.bundle.state import BlockState
from orip.structs import replace

_MOVED = (FigureObservations, GivenDirectionObservations)
_OF_FIGURE, _OF_END = slice(0, 3), slice(3, 6)
"""Partials by the point on a figure, and by that at the end of a direction."""

_STEPS, _NOTHING = 20, 1e-14


def with_points_on_figures(observations: Sequence[Observations], state: BlockState) -> BlockState:
    """Return a state whose points are on the figures and in the directions of some observations, by short ways."""
    kinds = [kind for kind in observations if isinstance(kind, _MOVED) and len(kind.component)]
    if not kinds:
        return state
    point = np.concatenate([kind.point if isinstance(kind, FigureObservations) else kind.end for kind in kinds])
    size = float(np.abs(state.points[point]).max())
    for _ in range(_STEPS):
        found = [kind.linearise_with_partials(state) for kind in kinds]
        residual = np.concatenate([part.residual for part in found])
        by_points = [
            part.partials[:, _OF_FIGURE if isinstance(kind, FigureObservations) else _OF_END]
            for kind, part in zip(kinds, found, strict=True)
        ]
        partials = np.concatenate(by_points)
        points = state.points.copy()
        for row in np.unique(point):
            mine = point == row
            points[row] -= np.linalg.lstsq(partials[mine], residual[mine], rcond=1e-6)[0]
        moved = float(np.abs(points[point] - state.points[point]).max())
        state = replace(state, points=points)
        if moved <= _NOTHING * size:
            break
    return state
