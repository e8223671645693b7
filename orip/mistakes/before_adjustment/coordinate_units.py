"""Photo coordinates in another unit than millimetres: they do not suit the frame of their camera, or its distance.

Cameras with a sensor are measured in pixels: millimetres, or parts of the picture, are far smaller. Those with fiducial
marks are scaled by these.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from orip.arrays import FloatArray
from orip.errors import ProjectWarning
from orip.interior.definitions import Definitions
from orip.mistakes.before_adjustment.points_of_camera import points_of_cameras
from orip.records.observations.measurement import PhotoObservations
from orip.records.project.camera import Camera, Sensor
from orip.records.project.photo import Photo

COORDINATE_UNIT = "coordinate-unit"

_UNITS = {1e3: "micrometres", 1e4: "tenths of micrometres (0.0001 mm)", 1e-3: "metres", 1.0 / 25.4: "inches"}
"""Names of units by their number in a millimetre."""

_OUTSIDE, _TINY = 2.0, 0.03
"""Parts of half the longer side of the frame: in millimetres the farthest coordinate does not exceed the first, and
reaches the second."""

_FILLED = 0.3
"""Part of half the longer side that the coordinates reach in the right unit."""

_WIDEST, _NARROWEST = 3.0, 0.02
"""The same limits for the farthest coordinate over the principal distance, where no frame is given."""

_USUAL = (0.15, 1.5)
"""Farthest coordinate over the principal distance in the right unit, where no frame is given."""

_LARGEST_FRAME = 300.0
"""mm."""

_FEWEST, _FEWEST_PIXELS = 4, 10
"""Least number of photo points with which a camera is judged, and one with a sensor."""

_PIXELS, _EDGE = 5.0, 1.01
"""Least number of pixels in a unit that is taken for them, and the tolerance at the edge of the picture."""


def coordinates_in_other_units(definitions: Definitions, observations: PhotoObservations) -> Iterator[ProjectWarning]:
    """Yield a warning for each camera whose photo coordinates cannot be millimetres.

    Parameters
    ----------
    definitions : Definitions
    observations : PhotoObservations
        Of one bundle.
    """
    for camera, rows in points_of_cameras(definitions, observations, _is_measured_directly):
        if camera.sensor is not None and len(rows) >= _FEWEST_PIXELS:
            yield from _no_pixels(camera, camera.sensor, observations.measured[rows])
        elif camera.sensor is None and not camera.fiducials and len(rows) >= _FEWEST:
            yield from _warnings(camera, observations.measured[rows])


def _is_measured_directly(photo: Photo) -> bool:
    return photo.template is None and photo.scan is None


def _warnings(camera: Camera, xy: FloatArray) -> Iterator[ProjectWarning]:
    # corners of what is measured say as much as all of it
    xy = np.stack([column(xy[:, axis]) for column in (np.min, np.max) for axis in (0, 1)]).reshape(2, 2)
    reached = _reached(camera, xy - camera.parameters[1:3])
    limits = (_TINY, _OUTSIDE) if camera.frame is not None else (_NARROWEST, _WIDEST)
    if limits[0] <= reached <= limits[1]:
        return
    farthest = float(np.abs(xy).max())
    compared = (
        f"on a frame of {camera.frame[0]:g} x {camera.frame[1]:g} mm"
        if camera.frame is not None
        else f"with C = {camera.parameters[0]:g} mm"
    )
    text = f"photo coordinates reach {farthest:.6g} {compared}, but they have to be in mm{_meant(camera, xy)}"
    yield ProjectWarning(COORDINATE_UNIT, f"camera {camera.name}", text)


def _no_pixels(camera: Camera, sensor: Sensor, xy: FloatArray) -> Iterator[ProjectWarning]:
    """Yield a warning where coordinates lie within the sensor's millimetres, or within 1, and not in its pixels."""
    pixels, size = np.array([sensor.columns, sensor.rows]), np.array([sensor.width, sensor.height])
    low, high = xy.min(axis=0), xy.max(axis=0)
    centred = bool((low < 0.0).any())
    extents = {
        "mm from the upper left corner": (size, not centred, "divide them by the size of a pixel"),
        "mm from the centre": (
            0.5 * size, centred, "give the camera a frame = [width, height] in place of the sensor, or write pixels"
        ),
        "parts of the picture": (np.ones(2), not centred, "multiply them by the numbers of columns and rows"),
    }  # fmt: skip
    farthest = np.maximum(np.abs(low), np.abs(high))
    for unit, (extent, fits, remedy) in extents.items():
        parts = farthest / extent
        if fits and (pixels > _PIXELS * extent).all() and parts.max() <= _EDGE and parts.min() >= _FILLED:
            text = (
                f"photo coordinates reach {farthest[0]:.4g} and {farthest[1]:.4g} on a sensor of {sensor.columns} "
                f"columns and {sensor.rows} rows, but they have to be pixels; they seem to be {unit}: {remedy}"
            )
            yield ProjectWarning(COORDINATE_UNIT, f"camera {camera.name}", text)
            return


def _reached(camera: Camera, xy: FloatArray) -> float:
    """Return the farthest coordinate over half the frame, or over the principal distance without a frame."""
    if camera.frame is None:
        return float(np.abs(xy).max()) / camera.parameters[0]
    return float(np.abs(xy).max()) / (0.5 * max(camera.frame))


def _meant(camera: Camera, xy: FloatArray) -> str:
    """Return in what unit the coordinates probably are, as a clause."""
    if _are_pixels(xy):
        return "; they seem to be pixels: give the camera a sensor = { columns, rows, width, height }, and no frame"
    filled = (_FILLED, _OUTSIDE) if camera.frame is not None else _USUAL
    units = [
        f"; they seem to be in {unit}: multiply them by {1.0 / size:g}"
        for size, unit in _UNITS.items()
        if filled[0] <= _reached(camera, xy / size) <= filled[1]
    ]
    return units[0] if units else ": correct their unit"


def _are_pixels(xy: FloatArray) -> bool:
    """Tell whether coordinates count from a corner and exceed the millimetres of any frame."""
    return bool(xy.min() >= 0.0 and xy.max() > _LARGEST_FRAME)
