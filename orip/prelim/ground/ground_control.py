"""What ground control gives to preliminary values: positions in the frame of the block, with their a-priori errors."""

from __future__ import annotations

import numpy as np

from orip.arrays import FloatArray
from orip.prelim.similarity.absolute_orientation import KnownPositions
from orip.records.block import Block
from orip.records.names import record_key


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
