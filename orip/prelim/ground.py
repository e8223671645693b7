"""From the ground to the block and back: what control gives, a datum where there is none, the project's coordinates."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from orip.arrays import FloatArray
from orip.geometry.rotation import angles_from_rotation
from orip.geometry.similarity import Similarity
from orip.prelim.growing_block import GrowingBlock
from orip.prelim.rays import ImageRays
from orip.prelim.similarity.absolute_orientation import KnownPositions
from orip.records.block import Block
from orip.records.control import ControlDistance, PreliminaryPoint
from orip.records.ground import GroundSystem, PlainGround
from orip.records.names import record_key
from orip.records.preliminary import PartialBlock, PhotoStart, PointStarts, PreliminaryValues
from orip.structs import replace
from orip.units import DEGREES_PER_RADIAN
from orip.wording import counted

_SAME_PLACE = 0.01
"""Of the longest base from the first photo: photos nearer than this were taken from one place, as from a tripod."""


def with_arbitrary_datum(
    grown: GrowingBlock, rays: ImageRays, distances: Sequence[ControlDistance], reason: str
) -> tuple[GrowingBlock, str]:
    """Transform a block to the system of its first photo, at the scale of measured distances if there are any.

    Parameters
    ----------
    grown : GrowingBlock
        With two photos at least.
    distances : sequence of ControlDistance
        Ground units; only spatial distances between known points are used. Without any, the scale is such that the
        first base is 1: that from the first photo to the next one at another place.
    reason : str
        Why there is no other datum.

    Returns
    -------
    GrowingBlock
    str
        A sentence that says what the system is.
    """
    first = int(np.flatnonzero(grown.oriented)[0])
    ratios = ratios_of_distances(grown, rays, distances)
    if ratios:
        scale = float(np.median(ratios))
        size = f"its scale comes from {counted(len(ratios), 'distance')}"
    else:
        other, base = _first_base(grown, first)
        scale = 1.0 / base
        size = f"its scale is arbitrary: the base from photo {rays.photos[first]} to photo {rays.photos[other]} is 1"
    to_photo = grown.rotations[first].T
    similarity = Similarity(scale, to_photo, -scale * (to_photo @ grown.centres[first]))
    name = rays.photos[first]
    finding = f"{reason}: origin and axes of the block are those of photo {name}, {size}"
    return grown.transformed(similarity), finding


def ratios_of_distances(grown: GrowingBlock, rays: ImageRays, distances: Sequence[ControlDistance]) -> list[float]:
    """Return given over computed lengths of spatial distances between known points."""
    place = {name: row for row, name in enumerate(rays.points)}
    known = grown.known
    ratios = []
    for distance in distances:
        start, end = place.get(distance.start), place.get(distance.end)
        if distance.code == "XYZ" and distance.error >= 0.0 and start is not None and end is not None:
            length = float(np.linalg.norm(grown.coordinates[end] - grown.coordinates[start]))
            if known[start] and known[end] and length > 0.0:
                ratios.append(distance.distance / length)
    return ratios


def _first_base(grown: GrowingBlock, first: int) -> tuple[int, float]:
    """Return the next photo that was not taken from the place of the first one, and its distance from it."""
    apart = np.where(grown.oriented, np.linalg.norm(grown.centres - grown.centres[first], axis=1), 0.0)
    other = int(np.flatnonzero(apart > _SAME_PLACE * apart.max())[0])
    return other, float(apart[other])


def known_points(block: Block) -> KnownPositions:
    """Return the points of a block that are known at least in part: control points and observed point coordinates.

    Returns
    -------
    KnownPositions
        In the frame of the block. Check points and rejected ones are not among them.
    """
    given = np.full((len(block.point_names), 3), np.nan)
    errors = np.full_like(given, np.nan)
    place = block.point_index()
    for point in block.control_points:
        if point.kind == "control":
            row = place[point.name]
            for axis, (value, error) in enumerate(zip(point.coordinates, point.errors, strict=True)):
                if value is not None and error is not None and error >= 0.0:
                    given[row, axis], errors[row, axis] = value, error
    for element in block.elements:
        if element.group == "POINT" and element.error >= 0.0:
            row, axis = place[element.name], "XYZ".index(element.kind)
            given[row, axis], errors[row, axis] = element.value, element.error
    rows = np.flatnonzero(np.isfinite(given).any(axis=1))
    names = tuple(block.point_names[row] for row in rows)
    return KnownPositions(names, _in_frame(block, given[rows]), errors[rows])


def approximate_points(block: Block) -> KnownPositions:
    """Return the points of a free network with approximate coordinates: preliminary ones, else those of .PNT.

    Returns
    -------
    KnownPositions
        In the frame of the block, without a-priori errors: all have the same weight.
    """
    of_control = (point for point in block.control_points if None not in point.coordinates and not point.rejected)
    given = {point.name: point.coordinates for point in of_control}
    measured = block.point_index()
    given |= {point.name: point.coordinates for point in block.preliminary if point.name in measured}
    coordinates = np.array(list(given.values()), dtype=np.float64).reshape(-1, 3)
    return KnownPositions(tuple(given), block.ground.to_local(coordinates), np.full(coordinates.shape, np.nan))


def known_centres(block: Block) -> KnownPositions:
    """Return the projection centres that are given, in the frame of the block.

    Those of exposure stations have their a-priori errors, all others none. The lever arm counts as an error: without
    attitudes it is not known where it points to.
    """
    centres = block.photo_orientation[:, :3].copy()
    errors = np.full_like(centres, np.nan)
    row_of = {record_key(photo.name): row for row, photo in enumerate(block.photos)}
    for station in block.stations:
        if station.has_position and min(station.position_error) >= 0.0:
            row = row_of[record_key(station.photo)]
            if np.isnan(centres[row]).any():
                centres[row] = block.ground.to_local(np.array([station.position]))[0]
            errors[row] = np.hypot(station.position_error, _length_of_arm(block, row))
    rows = np.flatnonzero(np.isfinite(centres).all(axis=1))
    names = tuple(block.photos[row].name for row in rows)
    return KnownPositions(names, centres[rows], errors[rows])


def _length_of_arm(block: Block, photo: int) -> float:
    """Return the length of the lever arm of a photo's antenna, 0 without one."""
    key = record_key(block.cameras[block.photo_camera[photo]].name)
    for antenna in block.antennas:
        if not antenna.cameras or key in map(record_key, antenna.cameras):
            return float(np.linalg.norm(antenna.lever_arm))
    return 0.0


def _in_frame(block: Block, given: FloatArray) -> FloatArray:
    """Return coordinates in the frame; unknown ones stay NaN, and are replaced by medians for the transformation."""
    unknown = np.isnan(given)
    columns = given.T
    middle = [float(np.median(column[np.isfinite(column)])) if np.isfinite(column).any() else 0.0 for column in columns]
    local = block.ground.to_local(np.where(unknown, middle, given)).copy()
    local[unknown] = np.nan
    return local


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
