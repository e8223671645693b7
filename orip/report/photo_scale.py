"""The scale of photos: how far their points are, and how large a pixel is on the object."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from msgspec import Struct

from orip.arrays import FloatArray
from orip.interior.pixels import pixel_size
from orip.records.names import record_key
from orip.records.project.camera import Camera
from orip.records.results.solution import Solution
from orip.report.report_input import ReportInput


class PhotoScale(Struct, frozen=True):
    """Scales of n photos, in the order of the solution; NaN where something is not known.

    Parameters
    ----------
    depth : array (n,)
        Median distance of a photo's points from the projection centre along the camera axis, ground unit.
    principal_distance, pixel : arrays (n,)
        mm.
    axes : array (n, 3)
        Directions in which the photos look, ground coordinates.
    """

    depth: FloatArray
    principal_distance: FloatArray
    pixel: FloatArray
    axes: FloatArray

    @property
    def scale_number(self) -> FloatArray:
        """Return the depth divided by the principal distance, ground units a millimetre."""
        return self.depth / self.principal_distance

    @property
    def pixel_on_object(self) -> FloatArray:
        """Return the ground sampling distance: the size of a pixel at the median depth, ground unit."""
        return self.scale_number * self.pixel


def photo_scale(given: ReportInput) -> PhotoScale:
    """Return the scales of all photos of a solution."""
    solution = given.solution
    cameras = _adjusted(solution)
    c = np.array([_principal_distance(given, cameras, name) for name in solution.photos.names])
    pixel = np.array([pixel_of_photo(given, name) for name in solution.photos.names])
    return PhotoScale(given.depths, c, pixel, given.axes)


def pixel_of_photo(given: ReportInput, name: str) -> float:
    """Return the mean size (mm) of a photo's pixels; NaN where it was not measured in pixels."""
    photo, camera = given.photos.get(record_key(name)), camera_of_photo(given, name)
    if photo is None or camera is None:
        return np.nan
    template = given.templates.get(record_key(photo.template)) if photo.template is not None else None
    size = pixel_size(photo, camera, template, None)
    return float(np.mean(size)) if size is not None else np.nan


def pixel_of_camera(given: ReportInput, camera: str) -> float:
    """Return the size (mm) of the pixels of a camera's photos; NaN where they have none, or not all the same."""
    sizes = [
        pixel_of_photo(given, photo.name)
        for photo in given.photos.values()
        if record_key(photo.camera) == record_key(camera)
    ]
    return sizes[0] if sizes and np.ptp(sizes) <= 1e-9 * sizes[0] else np.nan


def camera_of_photo(given: ReportInput, name: str) -> Camera | None:
    """Return the camera of a photo; None if it is not known."""
    photo = given.photos.get(record_key(name))
    return given.cameras.get(record_key(photo.camera)) if photo is not None else None


def _principal_distance(given: ReportInput, cameras: Mapping[str, float], name: str) -> float:
    """Return the adjusted principal distance of a photo's camera, mm."""
    photo = given.photos.get(record_key(name))
    return cameras.get(record_key(photo.camera), np.nan) if photo is not None else np.nan


def _adjusted(solution: Solution) -> dict[str, float]:
    return dict(zip(map(record_key, solution.cameras.names), solution.cameras.values[:, 0].tolist(), strict=True))
