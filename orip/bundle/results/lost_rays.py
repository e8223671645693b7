"""Photo points that have no influence since the solution puts their points behind the camera.

One may be a blunder. Where most rays of a photo or of the control points are lost, the solution is not that of the
block that was measured, however well the rest fits.
"""

from __future__ import annotations

import numpy as np

from orip.arrays import BoolArray
from orip.bundle.kinds.photo_point import PhotoPointObservations
from orip.bundle.solve import SolvedBlock

_MOST = 0.5


def lost_rays(solved: SolvedBlock) -> BoolArray:
    """Return which of the block's photo points (n,) are used, but lie behind their camera."""
    start = 0
    for kind in solved.problem.observations:
        rows = slice(start, start + len(kind.rows.used))
        start = rows.stop
        if isinstance(kind, PhotoPointObservations):
            active = solved.equations.active[rows]
            if active.all():  # mostly
                return np.zeros(len(kind.point), dtype=bool)
            idle = kind.rows.used & ~active
            if solved.problem.excluded is not None:
                idle &= ~solved.problem.excluded[rows]
            return np.asarray(idle.reshape(-1, 2).any(axis=1))
    return np.zeros(0, dtype=bool)


def lost_control(solved: SolvedBlock) -> tuple[str, ...]:
    """Return the control points none of whose used rays has an influence; empty unless they are the majority."""
    block, lost = solved.block, lost_rays(solved)
    if not lost.any():
        return ()
    points = block.photo_points
    used = points.partly_in_use
    rays = np.bincount(points.point[used], minlength=len(block.point_names))
    gone = np.bincount(points.point[lost], minlength=len(block.point_names))
    place = block.point_index()
    control = [point.name for point in block.control_points if point.kind == "control" and rays[place[point.name]]]
    found = tuple(name for name in control if gone[place[name]] == rays[place[name]])
    return found if len(found) > _MOST * len(control) else ()


def lost_photos(solved: SolvedBlock) -> tuple[str, ...]:
    """Return the photos behind which most of their points lie."""
    block, lost = solved.block, lost_rays(solved)
    if not lost.any():
        return ()
    points = block.photo_points
    used = np.bincount(points.photo[points.partly_in_use], minlength=len(block.photos))
    gone = np.bincount(points.photo[lost], minlength=len(block.photos))
    return tuple(photo.name for row, photo in enumerate(block.photos) if gone[row] > _MOST * used[row])
