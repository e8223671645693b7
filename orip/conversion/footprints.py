"""What a photo shows of level ground."""

from __future__ import annotations

import numpy as np

from orip.arrays import FloatArray
from orip.conversion.cameras import directions_of_pixels
from orip.records.project.camera import Camera

_STEEPEST = 10.0
"""A corner farther away, in heights above the ground, is near the horizon: its place says nothing."""


def footprint(camera: Camera, rotation: FloatArray, centre: FloatArray, ground_height: float) -> FloatArray | None:
    """Return where the rays of the four corners of a photo, with its distortion, meet level ground.

    Parameters
    ----------
    camera : Camera
        With a sensor.
    rotation : array (3, 3)
        Photo axes to ground axes.
    centre : array (3,)
    ground_height : float
        Z of the ground.

    Returns
    -------
    array (4, 3), or None
        Upper left, upper right, lower right, lower left; None where a corner does not show the ground below.
    """
    sensor = camera.sensor
    if sensor is None:
        message = f"camera {camera.name} has no sensor"
        raise ValueError(message)
    columns, rows = float(sensor.columns), float(sensor.rows)
    corners = np.array([[0.0, 0.0], [columns, 0.0], [columns, rows], [0.0, rows]])
    tangents = directions_of_pixels(camera, corners)
    if not np.isfinite(tangents).all():
        return None
    directions = np.column_stack([tangents, -np.ones(4)]) @ rotation.T
    above = centre[2] - ground_height
    reach = np.hypot(directions[:, 0], directions[:, 1])
    if above <= 0.0 or (reach > -_STEEPEST * directions[:, 2]).any():
        return None
    found: FloatArray = centre + directions * (above / -directions[:, 2])[:, None]
    found[:, 2] = ground_height
    return found
