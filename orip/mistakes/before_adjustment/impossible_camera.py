"""Cameras that cannot exist: angles of view that no lens has, pixels that are not square."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from orip.errors import ProjectWarning
from orip.interior.fiducial_system import frame_corners
from orip.mistakes.length_units import millimetres_per_unit
from orip.records.project.camera import Camera

_LONGEST = 20.0
"""Largest ratio of principal distance to diagonal of the frame: the angle of view is 3°, that of a telescope."""

_SHORTEST = 0.1
"""Smallest such ratio: the angle of view is 157°, of a fisheye 573° from corner to corner, which no lens has."""

_SQUARE = 1.05
"""Largest ratio of the sides of a pixel; sensor sizes in data sheets are rounded to a hundredth."""


def camera_warnings(camera: Camera) -> Iterator[ProjectWarning]:
    """Yield a warning for a principal distance that does not suit the frame, and for pixels that are not square."""
    where = f"camera {camera.name}"
    for text in (_angle_of_view(camera), _pixels(camera)):
        if text:
            yield ProjectWarning("senseless-camera", where, text)


def _angle_of_view(camera: Camera) -> str:
    corners, c = frame_corners(camera), camera.parameters[0]
    if corners is None:
        return ""
    width, height = (corners[1] - corners[0]).tolist()
    diagonal = float(np.hypot(width, height))
    if _is_possible(c, diagonal):
        return ""
    angle = float(np.degrees(_angle_at(camera, c, diagonal)))
    shown = f"{angle:.0f}" if angle >= 10.0 else f"{angle:.2g}"
    return (
        f"C = {c:g} mm on a frame of {width:g} x {height:g} mm would be an angle of view of {shown}°; C is in mm"
        f"{_meant(camera, diagonal)}"
    )


def _angle_at(camera: Camera, c: float, diagonal: float) -> float:
    """Return the angle of view, radians."""
    return diagonal / c if camera.projection == "equidistant" else float(2.0 * np.arctan(0.5 * diagonal / c))


def _is_possible(c: float, diagonal: float) -> bool:
    return _SHORTEST < c / diagonal < _LONGEST


def _meant(camera: Camera, diagonal: float) -> str:
    """Return what C would be if it was written in another unit by mistake, for those units that are possible."""
    c = camera.parameters[0]
    listed = ", ".join(
        f"if it is in {unit}: C = {c * size:.4g} mm"
        for unit, size in millimetres_per_unit(camera).items()
        if _is_possible(c * size, diagonal)
    )
    return f" ({listed})" if listed else ""


def _pixels(camera: Camera) -> str:
    sensor = camera.sensor
    if sensor is None:
        return ""
    width, height = sensor.width / sensor.columns, sensor.height / sensor.rows
    if _are_square(width, height):
        return ""
    text = f"the sensor's pixels would be {width * 1e3:.3g} x {height * 1e3:.3g} µm, but pixels are square"
    if _are_square(sensor.height / sensor.columns, sensor.width / sensor.rows):
        return f"{text}; they are if width and height are exchanged: exchange them"
    return f"{text}; check columns, rows, width and height of the sensor (of the image as measured: not cropped)"


def _are_square(width: float, height: float) -> bool:
    return max(width / height, height / width) <= _SQUARE
