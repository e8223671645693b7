"""The photo points of all bundles while a log is replayed, and what a replay finds wrong or worth knowing."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from itertools import compress
from types import MappingProxyType
from typing import Any

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from orip.arrays import BoolArray, FloatArray, IntArray, distinct
from orip.errors import Complaint, ProjectWarning
from orip.geometry.plane import PlaneTransformation
from orip.interior.mounting import STORED
from orip.records.coded_names import coded, joined, repeated, rows_of_records
from orip.records.measurement import EditRecord, PhotoObservations, PointsRecord, TextPlace
from orip.records.names import record_key
from orip.records.photo import Photo
from orip.structs import replace

ToStored = Callable[[str, int], PlaneTransformation | None]
"""Photo and mounting to the transformation that takes points measured then to stored coordinates, None if unknown."""

PixelSizes = Callable[[str, int], tuple[float, float]]
"""Photo and mounting to the size of a pixel (mm) along the photo axes; asked of scans and digital frames alone."""


class PointsOfPhoto(Struct, frozen=True):
    """n measured points of one photo in the order of their first measurement.

    Parameters
    ----------
    names : tuple of str, length n
    measured : array (n, 2)
        In the mounting of that number.
    errors : array (n, 2)
        Own a-priori errors, mm or, where `errors_in_pixels`, pixels; NaN: none.
    errors_in_pixels : array (n, 2) of bool
    disregarded : array (n,) of bool
    mounting : array (n,) of int
    """

    names: tuple[str, ...]
    measured: FloatArray
    errors: FloatArray
    errors_in_pixels: BoolArray
    disregarded: BoolArray
    mounting: IntArray

    def where(self, kept: BoolArray) -> PointsOfPhoto:
        """Return some of the n points, chosen by flags (n,)."""
        return PointsOfPhoto(tuple(compress(self.names, kept)), *(array[kept] for array in self._arrays()))

    def measured_again(self, new: PointsOfPhoto) -> tuple[PointsOfPhoto, int]:
        """Return these points with new measurements in their places or behind them, and how many are not the first."""
        if not self.names and len(set(new.names)) == len(new.names):
            return new, 0
        place = {name: row for row, name in enumerate(self.names)}
        rows, again = [], 0
        for name in new.names:
            again += name in place
            rows.append(place.setdefault(name, len(place)))
        joined = []
        for old, changed in zip(self._arrays(), new._arrays(), strict=True):
            column = np.concatenate([old, np.empty((len(place) - len(old), *old.shape[1:]), dtype=old.dtype)])
            column[rows] = changed  # of a name that comes twice the last one stays
            joined.append(column)
        return PointsOfPhoto(tuple(place), *joined), again

    def repeated(self, new: PointsOfPhoto) -> tuple[PointsOfPhoto, int]:
        """Return these points and further measurements of them or others, and how many are not the first."""
        again = len(self.names) + len(new.names) - len({*self.names, *new.names})
        again -= len(self.names) - len(set(self.names))
        arrays = (np.concatenate(both) for both in zip(self._arrays(), new._arrays(), strict=True))
        return PointsOfPhoto((*self.names, *new.names), *arrays), again

    def _arrays(self) -> tuple[NDArray[Any], ...]:
        return self.measured, self.errors, self.errors_in_pixels, self.disregarded, self.mounting


def points_of_record(record: PointsRecord, measured: FloatArray, mounting: int) -> PointsOfPhoto:
    """Return the points of a log record, in coordinates (n, 2) of the mounting of that number."""
    return PointsOfPhoto(
        record.names, measured, record.errors, record.errors_in_pixels, record.disregarded,
        np.full(len(record.names), mounting),
    )  # fmt: skip


_NO_POINTS = PointsOfPhoto(
    (), np.empty((0, 2)), np.empty((0, 2)), np.empty((0, 2), dtype=bool), np.empty(0, dtype=bool),
    np.empty(0, dtype=np.int64),
)  # fmt: skip


class MeasuredPoints:
    """Photo points by bundle, photo (both `record_key`) and name.

    Parameters
    ----------
    stored : mapping of bundle to PhotoObservations
        What is measured already.
    averaged : set of str
        Bundles in which the mean of all measurements of a point in a photo counts; in others the last one does.
    repeated : set of str
        Bundles in which every measurement of a point in a photo is an observation of its own.
    sources : mapping of str to str
        Bundles that have the points of another one, and that one: what is measured or edited there is so in them.
    """

    def __init__(
        self,
        stored: Mapping[str, PhotoObservations],
        averaged: frozenset[str] = frozenset(),
        repeated: frozenset[str] = frozenset(),
        sources: Mapping[str, str] = MappingProxyType({}),
    ) -> None:
        self._averaged, self._repeated = averaged, repeated
        self._sharing: dict[str, list[str]] = {}
        for bundle, source in sources.items():
            self._sharing.setdefault(source, []).append(bundle)
        self._bundles = {bundle: _points_by_photo(observations) for bundle, observations in stored.items()}
        for bundle, source in sources.items():
            if bundle not in stored and source in stored:
                self._bundles[bundle] = dict(self._bundles[source])
        self.remeasured = 0

    def measure(self, bundle: str, photo: str, points: PointsOfPhoto) -> None:
        """Take points of one photo, and count those that were measured before.

        A new measurement takes the place of the one before, unless all of the bundle stay.
        """
        self.remeasured += self._measure(bundle, photo, points)
        for other in self._sharing.get(bundle, ()):
            self._measure(other, photo, points)

    def _measure(self, bundle: str, photo: str, points: PointsOfPhoto) -> int:
        photos = self._bundles.setdefault(bundle, {})
        before = photos.get(photo, _NO_POINTS)
        stay = bundle in self._averaged | self._repeated
        photos[photo], again = before.repeated(points) if stay else before.measured_again(points)
        return again

    def differences(self, bundle: str, photo: str, points: PointsOfPhoto) -> list[tuple[str, FloatArray]]:
        """Return names of points that are there already, with new minus old coordinates (2,), of the same mounting."""
        before = self._bundles.get(bundle, {}).get(photo, _NO_POINTS)
        if not before.names:
            return []
        place = {name: row for row, name in enumerate(before.names)}
        return [
            (name, points.measured[row] - before.measured[place[name]])
            for row, name in enumerate(points.names)
            if name in place and before.mounting[place[name]] == points.mounting[row]
        ]

    def edit(self, bundle: str, record: EditRecord) -> int:
        """Disregard, include, kill or rename points; return how many the edit finds.

        Raises
        ------
        ValueError
            If a point would get the name of another one of its photo.
        """
        for other in self._sharing.get(bundle, ()):
            self._edit(other, record)
        return self._edit(bundle, record)

    def _edit(self, bundle: str, record: EditRecord) -> int:
        photos = self._bundles.get(bundle, {})
        keys = list(photos) if record.owner == "*" else [record_key(record.owner)]
        found = 0
        for key in keys:
            points = photos.get(key, _NO_POINTS)
            chosen = np.array([record.name in ("*", name) for name in points.names], dtype=bool)
            if not chosen.any():
                continue
            found += int(np.count_nonzero(chosen))
            if record.action == "KILL":
                photos[key] = points.where(~chosen)
            elif record.new_name is not None:
                photos[key] = _renamed(points, record.name, record.new_name, key)
            else:
                flags = np.where(chosen, record.action == "DISREGARD", points.disregarded)
                photos[key] = replace(points, disregarded=flags)
        return found

    def mountings(self, photo: str) -> set[int]:
        """Return the mountings in which points of a photo were measured."""
        of_photo = (photos.get(photo, _NO_POINTS) for photos in self._bundles.values())
        return {number for points in of_photo for number in distinct(points.mounting).tolist()}

    def require_orientations(
        self, bundles: Mapping[str, str], photos: Mapping[str, Photo], to_stored: ToStored, pixel_sizes: PixelSizes
    ) -> None:
        """Ask for all transformations and pixel sizes that `observations` asks for."""
        for by_photo in (self._bundles[key] for key in self._bundles if key in bundles):
            for photo in photos:
                points = by_photo.get(photo, _NO_POINTS)
                for number in distinct(points.mounting).tolist():
                    to_stored(photo, number)
                in_pixels = points.errors_in_pixels.any(axis=1)
                for number in distinct(points.mounting[in_pixels]).tolist():
                    pixel_sizes(photo, number)

    def observations(
        self, bundles: Mapping[str, str], photos: Mapping[str, Photo], to_stored: ToStored, pixel_sizes: PixelSizes
    ) -> dict[str, PhotoObservations]:
        """Return the points of the defined bundles and photos in stored coordinates, photos in their given order."""
        return {
            key: _observations(bundles[key], by_photo, photos, to_stored, pixel_sizes, key in self._averaged)
            for key, by_photo in self._bundles.items()
            if key in bundles
        }


def _renamed(points: PointsOfPhoto, name: str, new_name: str, photo: str) -> PointsOfPhoto:
    if new_name in points.names and new_name != name:
        message = (
            f"point {name} of photo {photo} cannot be renamed: {new_name} is measured there, too; kill one of them"
        )
        raise ValueError(message)
    return replace(points, names=tuple(new_name if found == name else found for found in points.names))


def _points_by_photo(observations: PhotoObservations) -> dict[str, PointsOfPhoto]:
    points = coded(observations.points)
    return {
        key: PointsOfPhoto(
            tuple(points[rows]),
            observations.measured[rows],
            observations.errors[rows],
            np.zeros((len(rows), 2), dtype=bool),
            observations.disregarded[rows],
            np.full(len(rows), STORED),
        )
        for key, rows in rows_of_records(observations.photos).items()
    }


def _observations(
    bundle: str,
    by_photo: Mapping[str, PointsOfPhoto],
    photos: Mapping[str, Photo],
    to_stored: ToStored,
    pixel_sizes: PixelSizes,
    averaged: bool,
) -> PhotoObservations:
    found = [
        (key, _stored(key, points, to_stored, pixel_sizes))
        for key in photos
        if (points := by_photo.get(key, _NO_POINTS)).names
    ]
    if averaged:
        found = [(key, _averaged(points)) for key, points in found]
    return PhotoObservations(
        bundle,
        joined(repeated(photos[key].name, len(points.names)) for key, points in found),
        coded([name for _, points in found for name in points.names]),
        np.vstack([np.empty((0, 2)), *(points.measured for _, points in found)]),
        np.vstack([np.empty((0, 2)), *(points.errors for _, points in found)]),
        np.concatenate([np.empty(0, dtype=bool), *(points.disregarded for _, points in found)]),
    )


def _stored(photo: str, points: PointsOfPhoto, to_stored: ToStored, pixel_sizes: PixelSizes) -> PointsOfPhoto:
    """Return the points in stored coordinates, with their errors in millimetres."""
    return replace(
        points,
        measured=_stored_coordinates(photo, points, to_stored),
        errors=_errors_in_millimetres(photo, points, pixel_sizes),
        mounting=np.full(len(points.names), STORED),
    )


def _averaged(points: PointsOfPhoto) -> PointsOfPhoto:
    """Return each point once: the mean of its measurements, without disregarded ones if there are others.

    The mean keeps the a-priori error of the last measurement: what is common to all of them is not averaged away.
    """
    place = {name: number for number, name in enumerate(dict.fromkeys(points.names))}
    if len(place) == len(points.names):
        return points
    number = np.array([place[name] for name in points.names])
    counts = ~points.disregarded
    disregarded = np.bincount(number, counts, len(place)) == 0.0
    taken = counts | disregarded[number]
    sums = [np.bincount(number[taken], axis[taken], len(place)) for axis in points.measured.T]
    last = np.zeros(len(place), dtype=np.int64)
    np.maximum.at(last, number[taken], np.flatnonzero(taken))
    return PointsOfPhoto(
        tuple(place),
        np.column_stack(sums) / np.bincount(number[taken], minlength=len(place))[:, None],
        points.errors[last],
        points.errors_in_pixels[last],
        disregarded,
        points.mounting[last],
    )


def _errors_in_millimetres(photo: str, points: PointsOfPhoto, pixel_sizes: PixelSizes) -> FloatArray:
    """Return own a-priori errors (n, 2)."""
    errors = points.errors.copy()
    in_pixels = points.errors_in_pixels.any(axis=1)
    for number in distinct(points.mounting[in_pixels]).tolist():
        size = np.where(points.errors_in_pixels, pixel_sizes(photo, number), 1.0)
        rows = in_pixels & (points.mounting == number)
        errors[rows] *= size[rows]
    return errors


def _stored_coordinates(photo: str, points: PointsOfPhoto, to_stored: ToStored) -> FloatArray:
    """Return stored coordinates (n, 2), NaN where the mounting is not oriented."""
    xy = points.measured.copy()
    for number in distinct(points.mounting).tolist():
        transformation = to_stored(photo, number)
        rows = points.mounting == number
        xy[rows] = transformation.apply(xy[rows]) if transformation else np.nan
    return xy


class Findings:
    """Complaints and warnings, in the order of the log whenever they were found."""

    def __init__(self) -> None:
        self._complaints: list[Complaint] = []
        self._warnings: list[ProjectWarning] = []
        self._files: dict[str, int] = {}

    def reads(self, place: TextPlace) -> None:
        """Note that a record is being taken: files are reported in the order in which they are read."""
        self._files.setdefault(place.path, len(self._files))

    def complain(self, place: TextPlace | None, message: str) -> None:
        """Add a complaint; without a place it concerns what was stored before."""
        complaint = Complaint(message, place.path, place.line) if place else Complaint(message)
        if complaint not in self._complaints:
            self._complaints.append(complaint)

    def warn(self, place: TextPlace, code: str, text: str) -> None:
        """Add a warning."""
        self._warnings.append(ProjectWarning(code, f"{place.path}:{place.line}", text))

    def complaints(self) -> tuple[Complaint, ...]:
        """Return the complaints, sorted by file and line."""
        return tuple(
            sorted(self._complaints, key=lambda finding: (self._files.get(finding.path, -1), finding.line or 0))
        )

    def warnings(self) -> tuple[ProjectWarning, ...]:
        """Return the warnings."""
        return tuple(self._warnings)
