"""The photo points of all bundles while a log is replayed: measured, measured again, edited."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from orip.geometry.plane import PlaneTransformation
from orip.interior.mounting import STORED
from orip.model.measurement import EditRecord, PhotoObservations
from orip.model.names import record_key
from orip.model.photo import Photo

FloatArray = NDArray[np.float64]

ToStored = Callable[[str, int], PlaneTransformation | None]
"""Photo and mounting to the transformation that takes points measured then to stored coordinates, None if unknown."""

PixelSizes = Callable[[str, int], tuple[float, float]]
"""Photo and mounting to the size of a pixel (mm) along the photo axes; asked of scans and digital frames alone."""


class MeasuredPoint(NamedTuple):
    """One measured point: coordinates in the mounting of that number, own a-priori errors (mm, or pixels if so)."""

    x: float
    y: float
    x_error: float
    y_error: float
    disregarded: bool
    mounting: int
    errors_in_pixels: tuple[bool, bool] = (False, False)


PointsOfPhoto = dict[str, MeasuredPoint]


class MeasuredPoints:
    """Photo points by bundle, photo (both `record_key`) and name.

    Parameters
    ----------
    stored : mapping of bundle to PhotoObservations
        What is measured already.
    """

    def __init__(self, stored: Mapping[str, PhotoObservations]) -> None:
        self._bundles = {bundle: _points_by_photo(observations) for bundle, observations in stored.items()}
        self.remeasured = 0

    def measure(self, bundle: str, photo: str, points: Iterable[tuple[str, MeasuredPoint]]) -> None:
        """Take points of one photo; one of a name that is there already replaces it and is counted."""
        known = self._bundles.setdefault(bundle, {}).setdefault(photo, {})
        for name, point in points:
            self.remeasured += name in known
            known[name] = point

    def edit(self, bundle: str, record: EditRecord) -> int:
        """Disregard, include or kill points; return how many the edit finds."""
        photos = self._bundles.get(bundle, {})
        keys = list(photos) if record.owner == "*" else [record_key(record.owner)]
        return sum(_edit_points(photos.get(key, {}), record) for key in keys)

    def mountings(self, photo: str) -> set[int]:
        """Return the mountings in which points of a photo were measured."""
        return {point.mounting for photos in self._bundles.values() for point in photos.get(photo, {}).values()}

    def observations(
        self, bundles: Mapping[str, str], photos: Mapping[str, Photo], to_stored: ToStored, pixel_sizes: PixelSizes
    ) -> dict[str, PhotoObservations]:
        """Return the points of the defined bundles and photos in stored coordinates, photos in their given order."""
        return {
            key: _observations(bundles[key], by_photo, photos, to_stored, pixel_sizes)
            for key, by_photo in self._bundles.items()
            if key in bundles
        }


def _edit_points(points: PointsOfPhoto, record: EditRecord) -> int:
    names = list(points) if record.name == "*" else [record.name] if record.name in points else []
    for name in names:
        if record.action == "KILL":
            del points[name]
        else:
            points[name] = points[name]._replace(disregarded=record.action == "DISREGARD")
    return len(names)


def _points_by_photo(observations: PhotoObservations) -> dict[str, PointsOfPhoto]:
    by_photo: dict[str, PointsOfPhoto] = {}
    rows = zip(
        observations.photos, observations.points, observations.measured.tolist(), observations.errors.tolist(),
        observations.disregarded.tolist(), strict=True,
    )  # fmt: skip
    for photo, name, (x, y), (x_error, y_error), disregarded in rows:
        point = MeasuredPoint(x, y, x_error, y_error, disregarded, STORED)
        by_photo.setdefault(record_key(photo), {})[name] = point
    return by_photo


def _observations(
    bundle: str,
    by_photo: Mapping[str, PointsOfPhoto],
    photos: Mapping[str, Photo],
    to_stored: ToStored,
    pixel_sizes: PixelSizes,
) -> PhotoObservations:
    found = [(key, by_photo[key]) for key in photos if by_photo.get(key)]
    points = [point for _, of_photo in found for point in of_photo.values()]
    errors = [_errors_in_millimetres(key, point, pixel_sizes) for key, of_photo in found for point in of_photo.values()]
    return PhotoObservations(
        bundle,
        tuple(photos[key].name for key, of_photo in found for _ in of_photo),
        tuple(name for _, of_photo in found for name in of_photo),
        np.vstack([np.empty((0, 2)), *(_stored_coordinates(key, of_photo, to_stored) for key, of_photo in found)]),
        np.array(errors, dtype=np.float64).reshape(-1, 2),
        np.array([point.disregarded for point in points], dtype=bool),
    )


def _errors_in_millimetres(photo: str, point: MeasuredPoint, pixel_sizes: PixelSizes) -> tuple[float, float]:
    if not any(point.errors_in_pixels):
        return point.x_error, point.y_error
    (x_size, y_size), (x_in_pixels, y_in_pixels) = pixel_sizes(photo, point.mounting), point.errors_in_pixels
    return point.x_error * (x_size if x_in_pixels else 1.0), point.y_error * (y_size if y_in_pixels else 1.0)


def _stored_coordinates(photo: str, points: PointsOfPhoto, to_stored: ToStored) -> FloatArray:
    """Return stored coordinates (n, 2), NaN where the mounting is not oriented."""
    xy = np.array([(point.x, point.y) for point in points.values()])
    mounting = np.array([point.mounting for point in points.values()])
    for number in np.unique(mounting).tolist():
        transformation = to_stored(photo, number)
        rows = mounting == number
        xy[rows] = transformation.apply(xy[rows]) if transformation else np.nan
    return xy
