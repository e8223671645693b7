"""What ground control gives to preliminary values: coordinates in the frame of the block, and their a-priori errors."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from orip.model.block import Block

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class GroundControl:
    """Control of a block, in its frame.

    Parameters
    ----------
    coordinates, errors : arrays (number of points, 3)
        NaN where a coordinate is not known, or no observation. Errors are a-priori ones, 0 for constants.
    centres : array (number of photos, 3)
        Projection centres that are given; NaN where they are not.
    """

    coordinates: FloatArray
    errors: FloatArray
    centres: FloatArray

    @property
    def full(self) -> NDArray[np.bool_]:
        """Return which points are known in all three coordinates, array (number of points,)."""
        return np.asarray(np.isfinite(self.coordinates).all(axis=1))


def ground_control(block: Block) -> GroundControl:
    """Return the control of a block: its control points, its observed point coordinates and projection centres."""
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
    local = _in_frame(block, given)
    errors[np.isnan(local)] = np.nan
    return GroundControl(local, errors, block.photo_orientation[:, :3])


def _in_frame(block: Block, given: FloatArray) -> FloatArray:
    """Return coordinates in the frame; one that is not known counts as the middle of the others, and stays unknown."""
    unknown = np.isnan(given)
    rows = ~unknown.all(axis=1)
    columns = given.T
    middle = [float(np.median(column[np.isfinite(column)])) if np.isfinite(column).any() else 0.0 for column in columns]
    local = given.copy()
    local[rows] = block.ground.to_local(np.where(unknown[rows], middle, given[rows]))
    local[unknown] = np.nan
    return local
