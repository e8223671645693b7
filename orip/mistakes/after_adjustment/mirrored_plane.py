"""A plane object seen from its other side: what a mirrored picture of it looks like.

A mirrored picture of points in a plane is what a camera behind the plane would see. The adjustment fits, with the
cameras on the wrong side; only their given positions show that.
"""

from __future__ import annotations

import numpy as np

from orip.errors import ProjectWarning
from orip.records.block import Block
from orip.records.results.solution import Solution

_FLAT = 0.01
"""Largest ratio of the extent across a plane to the smaller one within it."""

_FEWEST = 2
"""Photos that have to change sides; a single one may have been given wrong."""


def mirrored_plane(block: Block, solution: Solution) -> list[ProjectWarning]:
    """Return a warning if the adjustment puts all photos on the other side of a plane object.

    Parameters
    ----------
    block : Block
        As gathered: with the projection centres that were given.
    solution : Solution
    """
    given = block.ground.to_project(block.photo_orientation[:, :3])
    points = solution.points.values[np.isfinite(solution.points.values).all(axis=1)]
    known = np.isfinite(given).all(axis=1)
    if np.count_nonzero(known) < _FEWEST or len(points) <= _FEWEST + 1:
        return []
    centroid = points.mean(axis=0)
    away = points - centroid
    squares, axes = np.linalg.eigh(away.T @ away)  # ascending
    if squares[0] > _FLAT**2 * squares[1]:
        return []
    normal = axes[:, 0]
    sides = (given[known] - centroid) @ normal * ((solution.photos.values[known, :3] - centroid) @ normal)
    if not (sides < 0.0).all():
        return []
    text = (
        "the adjustment puts them on the other side of the plane of the points than given: the photos or the control "
        "are mirrored. Pixel rows may count upwards (they count down from the upper edge), or film may have been "
        "scanned from its back, or X and Y of the control are exchanged (X = east, Y = north)"
    )
    return [ProjectWarning("mirrored", "photos", text)]
