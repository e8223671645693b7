"""Cameras that make no sense: angles of view that no lens has, pixels that are not square."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from orip.errors import ProjectWarning
from orip.records.camera import Camera

_LONGEST = 20.0
"""Principal distance over the diagonal of the frame: an angle of view below 3°, that of a telescope."""

_SHORTEST = 0.1
"""An angle of view above 157°: no lens that images in perspective has it."""

_SQUARE = 1.05
"""Ratio of the sides of a pixel; sensor sizes in data sheets are rounded to a hundredth."""


def camera_warnings(camera: Camera) -> Iterator[ProjectWarning]:
    """Yield a warning for a principal distance, and for a sensor, that make no sense."""
    where, c = f"camera {camera.name}", camera.parameters[0]
    size = _frame(camera)
    if size is not None:
        diagonal = float(np.hypot(*size))
        angle = float(np.degrees(2.0 * np.arctan(0.5 * diagonal / c)))
        if not _makes_sense(c, diagonal):
            text = (
                f"C = {c:g} mm on a frame of {size[0]:g} x {size[1]:g} mm would be an angle of view of "
                f"{_shown(angle)}°; C is in mm{_meant(camera, diagonal)}"
            )
            yield ProjectWarning("senseless-camera", where, text)
    sensor = camera.sensor
    if sensor is None:
        return
    width, height = sensor.width / sensor.columns, sensor.height / sensor.rows
    if max(width / height, height / width) > _SQUARE:
        turned = sensor.height / sensor.columns, sensor.width / sensor.rows
        meant = max(turned[0] / turned[1], turned[1] / turned[0]) <= _SQUARE
        text = f"the sensor's pixels would be {width * 1e3:.3g} x {height * 1e3:.3g} µm, and pixels are square; " + (
            "they are if width and height are exchanged: exchange them"
            if meant
            else "check columns, rows, width and height of the sensor (of the image as measured: not cropped)"
        )
        yield ProjectWarning("senseless-camera", where, text)


def _makes_sense(c: float, diagonal: float) -> bool:
    return _SHORTEST < c / diagonal < _LONGEST


def _frame(camera: Camera) -> tuple[float, float] | None:
    """Return the size of what the camera images, mm; None where it is not known."""
    if camera.sensor is not None:
        return camera.sensor.width, camera.sensor.height
    if len(camera.fiducials) > 1:
        extent = np.ptp(np.array([(mark.x, mark.y) for mark in camera.fiducials]), axis=0)
        return (float(extent[0]), float(extent[1])) if extent.any() else None
    return camera.frame


def _shown(angle: float) -> str:
    return f"{angle:.0f}" if angle >= 10.0 else f"{angle:.2g}"


def _meant(camera: Camera, diagonal: float) -> str:
    """Return what C would be in the other units that it is written in by mistake, where that makes sense."""
    c, sensor = camera.parameters[0], camera.sensor
    units = [("metres", 1e3), ("inches", 25.4), *([("pixels", sensor.width / sensor.columns)] if sensor else [])]
    found = (f"if it is in {unit}: C = {c * size:.4g} mm" for unit, size in units if _makes_sense(c * size, diagonal))
    listed = ", ".join(found)
    return f" ({listed})" if listed else ""
