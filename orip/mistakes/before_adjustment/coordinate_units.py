"""Photo coordinates in another unit than millimetres: they do not suit the frame of their camera, or its distance.

Cameras with a sensor are measured in pixels, and those with fiducial marks are scaled by these; here are the others.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from orip.arrays import FloatArray
from orip.errors import ProjectWarning
from orip.interior.definitions import Definitions
from orip.mistakes.before_adjustment.points_of_camera import points_of_cameras
from orip.records.observations.measurement import PhotoObservations
from orip.records.project.camera import Camera
from orip.records.project.photo import Photo

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

_FEWEST = 4
"""Least number of photo points with which a camera is judged."""


def coordinates_in_other_units(definitions: Definitions, observations: PhotoObservations) -> Iterator[ProjectWarning]:
    """Yield a warning for each camera whose photo coordinates cannot be millimetres.

    Parameters
    ----------
    definitions : Definitions
    observations : PhotoObservations
        Of one bundle.
    """
    for camera, rows in points_of_cameras(definitions, observations, _is_measured_directly):
        if camera.sensor is None and not camera.fiducials and len(rows) >= _FEWEST:
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
    yield ProjectWarning("coordinate-unit", f"camera {camera.name}", text)


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
