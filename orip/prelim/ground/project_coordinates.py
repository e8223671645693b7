"""Preliminary values in the project's coordinates."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from orip.arrays import FloatArray
from orip.geometry.rotation import angles_from_rotation
from orip.prelim.rays.image_rays import ImageRays
from orip.records.ground import GroundSystem, PlainGround
from orip.records.observations.control import PreliminaryPoint
from orip.records.results.preliminary import PartialBlock, PhotoStart, PointStarts, PreliminaryValues
from orip.structs import replace
from orip.units import DEGREES_PER_RADIAN


def orientations_in_frame(photos: Sequence[PhotoStart]) -> FloatArray:
    """Return X0 Y0 Z0 omega phi kappa (number of photos, 6) in the frame of the block, radians; NaN where not found."""
    found = np.full((len(photos), 6), np.nan)
    for row, photo in enumerate(photos):
        if photo.centre is not None and photo.rotation is not None:
            found[row] = np.r_[photo.centre, angles_from_rotation(photo.rotation)]
    return found


def orientations_in_project(photos: Sequence[PhotoStart], ground: GroundSystem) -> FloatArray:
    """Return X0 Y0 Z0 omega phi kappa (number of photos, 6) as in the files, degrees; NaN where not found."""
    result = np.full((len(photos), 6), np.nan)
    rows = [row for row, photo in enumerate(photos) if photo.rotation is not None]
    if rows:
        local = np.array([photos[row].centre for row in rows])
        centres = ground.to_project(local)
        rotations = ground.axes_at(centres) @ np.array([photos[row].rotation for row in rows])
        result[rows] = np.hstack([centres, angles_from_rotation(rotations) * DEGREES_PER_RADIAN])
    return result


def points_in_project(points: PointStarts, ground: GroundSystem) -> list[PreliminaryPoint]:
    """Return points as a .PRE file has them; deviations are those along the axes of the frame."""
    xyz = ground.to_project(points.coordinates).tolist()
    deviations = [None if np.isnan(sx) else (sx, sy, sz) for sx, sy, sz in points.deviations.tolist()]
    return [
        PreliminaryPoint(name, (x, y, z), deviation)
        for name, (x, y, z), deviation in zip(points.names, xyz, deviations, strict=True)
    ]


def absolute_in_project(values: PreliminaryValues, ground: GroundSystem) -> PreliminaryValues:
    """Return values whose absolute orientation lists control points as the project has them.

    Where the project has a `crs`, residuals and parameters stay those of the local frame; a remark says so.
    """
    if values.absolute is None or isinstance(ground, PlainGround):
        return values
    coordinates = values.absolute.coordinates.copy()
    full = np.isfinite(coordinates).all(axis=1)
    coordinates[full] = ground.to_project(coordinates[full])
    remarks = (*values.absolute.remarks, "residuals, shift and rotation refer to the local frame: east, north and up")
    return replace(values, absolute=replace(values.absolute, coordinates=coordinates, remarks=remarks))


def block_in_project(values: PreliminaryValues, rays: ImageRays, ground: GroundSystem) -> PartialBlock:
    """Return the oriented photos and known points as one partial block, in the project's coordinates."""
    photos = [row for row, photo in enumerate(values.photos) if photo.rotation is not None]
    place = {name: row for row, name in enumerate(rays.points)}
    centres = ground.to_project(np.array([values.photos[row].centre for row in photos]).reshape(-1, 3))
    return PartialBlock(
        "",
        np.array(photos, dtype=np.int64),
        ground.axes_at(centres) @ np.array([values.photos[row].rotation for row in photos]).reshape(-1, 3, 3),
        centres,
        np.array([place[name] for name in values.points.names], dtype=np.int64),
        ground.to_project(values.points.coordinates),
        values.points.deviations,
    )
