"""The route by control for cameras of which next to nothing is known: direct linear transformation, then resection."""

from __future__ import annotations

import numpy as np

from orip.arrays import FloatArray
from orip.prelim.growing.block_grower import BlockGrower
from orip.prelim.refinement.camera_corrections import no_corrections
from orip.prelim.resection.direct_linear import DirectLinear, direct_linear
from orip.prelim.routes import Route, control_start
from orip.structs import replace


def by_unknown_cameras(grower: BlockGrower) -> Route:
    """Go by resection with the cameras that photos of six control points in space show; `grower` holds the control.

    A camera is corrected by the median of its photos, in principal distance and principal point as far as they are
    unknown.
    """
    corrections = _corrections(grower)
    if not corrections.any():
        return Route(())
    start = replace(control_start(grower), corrections=corrections)
    return Route((grower.grow(start),), on_ground=True)


def _corrections(grower: BlockGrower) -> FloatArray:
    """Return corrections (cameras, 4) as `orip.prelim.refinement.camera_corrections` has them."""
    rays, corrections = grower.rays, no_corrections(grower.rays)
    for camera, unknown in enumerate(rays.cameras.unknown):
        shown: list[tuple[float, float, float]] = []
        for photo in np.flatnonzero(rays.cameras.of_photo == camera):
            rows = grower.index.rows[photo][grower.held_points[grower.index.points[photo]]]
            found = direct_linear(rays.vectors[rows, :2], grower.held[rays.point[rows]])
            if isinstance(found, DirectLinear):
                given = float(-rays.vectors[rows[0], 2])
                x, y = found.principal_point
                shown.append((np.log(found.principal_distance / given), -x / given, -y / given))
        if shown:
            corrections[camera, :3] = np.where(unknown[:3], np.median(shown, axis=0), 0.0)
    return corrections
