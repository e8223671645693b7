"""Cameras that cannot exist: angles of view that no lens has, pixels that are not square."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np

from orip.errors import Complaint, InputError, ProjectWarning
from orip.interior.mounting import frame_corners
from orip.mistakes.length_units import millimetres_per_unit
from orip.records.project.camera import Camera, Sensor

_LONGEST = 20.0
"""Largest ratio of principal distance to diagonal of the frame: the angle of view is 3°, that of a telescope."""

_SHORTEST = 0.1
"""Smallest such ratio: the angle of view is 157°, of a fisheye 573° from corner to corner, which no lens has."""

_SQUARE = 1.05
"""Largest ratio of the sides of a pixel; sensor sizes in data sheets are rounded to a hundredth."""

_NO_LENS = 0.01
"""Ratio of principal distance to diagonal of the frame below which it is in another unit: a fisheye has 0.2."""

_SMALLEST_PIXEL, _SMALL_PIXEL = 1e-4, 1e-3
"""mm. The first is a fifth of the wavelength of light, and of the smallest pixel that is made; few are smaller than the
second."""

_SIZES = (1.0, 300.0)
"""Longer sides of frames, mm: of phones, of aerial cameras."""

_USUAL = (0.2, 10.0)
"""Ratios of principal distance to diagonal: of fisheyes, of long lenses."""


def raise_if_impossible(cameras: Iterable[Camera]) -> None:
    """Refuse cameras whose principal distance or sensor is surely in another unit, or the size of a pixel.

    An adjustment of them could only blame other data.

    Raises
    ------
    InputError
        With the values to write.
    """
    found = [
        Complaint(f"camera {camera.name}: {text}")
        for camera in cameras
        if (text := _tiny_sensor(camera) or _tiny_frame(camera) or _in_metres(camera))
    ]
    if found:
        raise InputError(tuple(found))


def _tiny_sensor(camera: Camera) -> str:
    """Return what is wrong with a sensor whose pixels would be smaller than the wavelength of light."""
    sensor = camera.sensor
    if sensor is None:
        return ""
    pixel = (sensor.width / sensor.columns, sensor.height / sensor.rows)
    is_pixel = _are_square(sensor.width, sensor.height) and not _are_square(float(sensor.columns), float(sensor.rows))
    if max(pixel) >= (_SMALL_PIXEL if is_pixel else _SMALLEST_PIXEL):
        return ""
    text = (
        f"a sensor of {sensor.width:g} x {sensor.height:g} mm with {sensor.columns} columns and {sensor.rows} rows "
        f"would have pixels of {pixel[0] * 1e3:.2g} x {pixel[1] * 1e3:.2g} µm, which no camera has; width and height "
        "are those of the whole sensor in mm"
    )
    meant = [
        f"{what}: write width = {size[0]:.5g}, height = {size[1]:.5g}"
        for what, size in _sizes_meant(sensor).items()
        if _is_usual(camera, size)
    ]
    return f"{text}; they seem to be {' (or '.join(meant)}{')' * (len(meant) - 1)}" if meant else text


def _sizes_meant(sensor: Sensor) -> dict[str, tuple[float, float]]:
    """Return width and height of the sensor, mm, by what may have been written in their place."""
    width, height = sensor.width, sensor.height
    sizes = {"in metres": (width * 1e3, height * 1e3)}
    if _are_square(width, height):
        sizes["the size of a pixel in mm"] = (width * sensor.columns, height * sensor.rows)
        sizes["the size of a pixel in µm"] = (width * sensor.columns * 1e-3, height * sensor.rows * 1e-3)
    return {what: size for what, size in sizes.items() if _are_square(size[0] / sensor.columns, size[1] / sensor.rows)}


def _is_usual(camera: Camera, size: tuple[float, float]) -> bool:
    """Tell whether a frame is one that cameras have, with the principal distance as it is, or in metres."""
    diagonal, c = float(np.hypot(*size)), camera.parameters[0]
    fits = any(_USUAL[0] <= c * factor / diagonal <= _USUAL[1] for factor in (1.0, 1e3))
    return fits and _SIZES[0] <= max(size) <= _SIZES[1]


def _tiny_frame(camera: Camera) -> str:
    """Return that a frame, far smaller than its principal distance, is in metres."""
    if camera.frame is None or camera.parameters[0] / np.hypot(*camera.frame) < 1.0 / _NO_LENS:
        return ""
    width, height = (side * 1e3 for side in camera.frame)
    if max(camera.frame) >= _SIZES[0] or not _is_usual(camera, (width, height)):
        return ""
    return (
        f"a frame of {camera.frame[0]:g} x {camera.frame[1]:g} mm with C = {camera.parameters[0]:g} mm seems to be in "
        f"metres; write frame = [{width:.6g}, {height:.6g}]"
    )


def _in_metres(camera: Camera) -> str:
    corners, c = frame_corners(camera), camera.parameters[0]
    if corners is None:
        return ""
    width, height = (corners[1] - corners[0]).tolist()
    ratio = c / float(np.hypot(width, height))
    if ratio >= _NO_LENS or not _USUAL[0] <= 1e3 * ratio <= _USUAL[1]:
        return ""
    return (
        f"C = {c:g} mm on a frame of {width:g} x {height:g} mm is that of no lens; it seems to be in metres, but C is "
        f"in mm: write c = {c * 1e3:.10g}"
    )


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
