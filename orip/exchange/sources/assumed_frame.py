"""A frame for cameras of formats that measure in millimetres and do not say how large the frame is."""

from __future__ import annotations

import numpy as np

from orip.arrays import FloatArray
from orip.records.exchanged import ExchangedCamera
from orip.structs import replace

PIXEL_MM = 0.01
"""Of the pixels that stand for millimetres."""

_SMALLEST_MM = 10.0


def with_assumed_frame(
    camera: ExchangedCamera, image: FloatArray, pixel_mm: float = PIXEL_MM
) -> tuple[ExchangedCamera, str]:
    """Return a camera whose frame holds all measurements (n, 2), millimetres from its centre, and a note on it."""
    reach = np.abs(image).max(axis=0) if len(image) else np.zeros(2)
    width, height = (max(_SMALLEST_MM, float(np.ceil(2.0 * side))) for side in np.minimum(reach, 1e4).tolist())
    found = replace(
        camera,
        columns=round(width / pixel_mm),
        rows=round(height / pixel_mm),
        sensor_mm=(width, height),
    )
    note = (
        f"The frame of camera {camera.name} is in no file: {width:.0f} x {height:.0f} mm hold all its measurements, "
        f"and pixels of {pixel_mm:g} mm stand for millimetres."
    )
    return found, note
