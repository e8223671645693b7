"""How far a camera's photos reach."""

from __future__ import annotations

import numpy as np

from orip.arrays import FloatArray
from orip.records.camera import Camera


def frame_corners(camera: Camera) -> tuple[FloatArray, FloatArray] | None:
    """Return the lower left and the upper right corner (mm, fiducial system) of a camera's frame.

    A frame or sensor is centred at the fiducial centre; where a camera has neither, its fiducial marks (reseau crosses,
    photo corners) tell how far it reaches. None where there is nothing to tell.
    """
    if camera.frame is not None:
        half = np.array(camera.frame) / 2.0
        return -half, half
    if camera.sensor is not None:
        half = np.array([camera.sensor.width, camera.sensor.height]) / 2.0
        return -half, half
    marks = np.array([(mark.x, mark.y) for mark in camera.fiducials])
    if len(marks) < 2 or np.ptp(marks, axis=0).min() <= 0.0:
        return None
    return marks.min(axis=0), marks.max(axis=0)
