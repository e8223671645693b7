"""What a report is made from, residuals of photo points as vectors, and scales of photos."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from urllib.parse import urlencode

import numpy as np
from msgspec import Struct, field
from numpy.typing import NDArray

from orip.arrays import FloatArray, IntArray
from orip.bundle.results.compared_points import COMPARED_KINDS, ComparedKind, ComparedPoints, compared_points
from orip.errors import ProjectWarning
from orip.geometry.rotation import rotation_from_angles
from orip.interior.image_coordinates import pixel_size
from orip.records.camera import Camera
from orip.records.coded_names import coded
from orip.records.definition import BundleDefinition, ReportDetails
from orip.records.names import record_key
from orip.records.observation_kinds import PHOTO_POINT
from orip.records.photo import Photo, Template
from orip.records.results.solution import Residuals, Solution
from orip.records.results.tests import GateResult
from orip.units import DEGREES_PER_RADIAN


class PhotoVectors(Struct, frozen=True):
    """Residual vectors of n photo points.

    Parameters
    ----------
    xy, residual : arrays (n, 2), mm
        Measured coordinates, and adjusted minus measured ones.
    sound : array (n,) of bool
        Neither component is down-weighted or disregarded.
    """

    photo: str
    xy: FloatArray
    residual: FloatArray
    sound: NDArray[np.bool_]

    @property
    def rms(self) -> float:
        """Return the root mean square (mm) of the components of the sound points, 0 where there are none."""
        sound = self.sound_residual
        return float(np.sqrt(np.vdot(sound, sound) / sound.size)) if sound.size else 0.0

    @property
    def sound_xy(self) -> FloatArray:
        """Return the measured coordinates (k, 2) of the sound points, mm."""
        return self.xy if self.sound.all() else self.xy[self.sound]

    @property
    def sound_residual(self) -> FloatArray:
        """Return the residuals (k, 2) of the sound points, mm."""
        return self.residual if self.sound.all() else self.residual[self.sound]


def photo_vectors(residuals: Residuals) -> dict[str, PhotoVectors]:
    """Return the residual vectors of each photo that has photo points; x and y are in successive rows."""
    rows = np.flatnonzero(coded(residuals.kind).where(PHOTO_POINT.name.__eq__))[::2]
    photo = coded(residuals.photo)[rows]
    if (photo.codes[1:] < photo.codes[:-1]).any():  # mostly measured photo by photo
        order = np.argsort(photo.codes, kind="stable")
        rows, photo = rows[order], photo[order]
    xy, residual, weight = (
        _in_pairs(values, rows) for values in (residuals.observed, residuals.residual, residuals.weight_factor)
    )
    sound = (weight == 1.0).all(axis=1)
    start = np.append(0, np.cumsum(np.bincount(photo.codes, minlength=len(photo.distinct)))).tolist()
    return {
        name: PhotoVectors(name, xy[first:last], residual[first:last], sound[first:last])
        for name, first, last in zip(photo.distinct, start[:-1], start[1:], strict=True)
        if first < last
    }


def _in_pairs(values: FloatArray, rows: IntArray) -> FloatArray:
    """Return the values (n, 2) in rows (n,) and those after them; as they lie where they follow each other."""
    if len(rows) and (np.diff(rows) == 2).all():
        return values[rows[0] : rows[-1] + 2].reshape(-1, 2)
    return values[np.stack([rows, rows + 1], axis=1)]


CHIP_PIXELS = 64
"""Columns and rows of the image that a chip shows."""


class AskedImage(Struct, frozen=True):
    """What is to be shown of the image of a photo: a thumbnail, and chips from their first columns and rows (n, 2)."""

    photo: str
    thumbnail: bool
    chips: IntArray


class GivenImage(Struct, frozen=True):
    """Its pictures as data addresses, in that order; `fault` says why there are none."""

    thumbnail: str = ""
    chips: tuple[str, ...] = ()
    fault: str = ""


PictureSource = Callable[[Sequence[AskedImage]], Sequence[GivenImage]]
"""Makes the pictures that are asked for, in their order."""


class ReportInput(Struct, frozen=True, dict=True):
    """A solution with the definitions that it is based on.

    Parameters
    ----------
    cameras : mapping of record_key to Camera
        Their parameters as they were before the adjustment.
    photos : mapping of record_key to Photo
    templates : mapping of record_key to Template
    crs : str or None
        Of the project.
    replayed : tuple of (str, str)
        Names and digests of the measurement files as they were replayed last.
    test_level : float or None
        Error probability of the test of one observation; None: that of all tests of the block together is stated.
    image_warnings : tuple of ProjectWarning
        Images of photos that cannot be used.
    pictures : PictureSource or None
        Pictures of photos for the page; None: it has none.
    screen : str
        Address of the page of `orip screen`, where that serves the report: what is named leads to it. Empty: a file.
    notice : str
        What is said before all else, that the solution is out of date for example.
    """

    solution: Solution
    gates: tuple[GateResult, ...]
    bundle: BundleDefinition
    cameras: Mapping[str, Camera]
    photos: Mapping[str, Photo]
    templates: Mapping[str, Template] = field(default_factory=dict)
    details: ReportDetails = field(default_factory=ReportDetails)
    crs: str | None = None
    replayed: tuple[tuple[str, str], ...] = ()
    test_level: float | None = None
    image_warnings: tuple[ProjectWarning, ...] = ()
    pictures: PictureSource | None = None
    screen: str = ""
    notice: str = ""

    def place(self, photo: str = "", point: str = "") -> str:
        """Return the address that shows a photo, a point in it, or a point where it is seen best; empty in a file."""
        known = {key: name for key, name in (("photo", photo), ("point", point)) if name in self._names[key]}
        return f"{self.screen}#{urlencode(known)}" if self.screen and known else ""

    @cached_property
    def _names(self) -> Mapping[str, frozenset[str]]:
        return {"photo": frozenset(self.solution.photos.names), "point": frozenset(self.solution.points.names)}

    @cached_property
    def photo_vectors(self) -> Mapping[str, PhotoVectors]:
        """Return the residual vectors of each photo that has photo points."""
        return photo_vectors(self.solution.residuals)

    @cached_property
    def reaches(self) -> Mapping[str, float]:
        """Return by the keys of cameras the largest distance (mm) of a photo point from the fiducial centre."""
        found: dict[str, float] = {}
        for name, vectors in self.photo_vectors.items():
            photo = self.photos.get(record_key(name))
            if photo is not None:
                x, y = vectors.xy.T
                key, most = record_key(photo.camera), float(np.max(x * x + y * y, initial=0.0))
                found[key] = max(most, found.get(key, 0.0))
        return {key: math.sqrt(most) for key, most in found.items()}

    @cached_property
    def compared(self) -> Mapping[ComparedKind, ComparedPoints]:
        """Return the control points and the check points."""
        return {kind: compared_points(self.solution, kind) for kind in COMPARED_KINDS}

    @cached_property
    def pixel_of_rows(self) -> FloatArray:
        """Return the pixel size (mm) of the photo of each row of the residuals; NaN where it is not known."""
        photo = coded(self.solution.residuals.photo)
        sizes = np.array([pixel_of_photo(self, name) for name in photo.distinct], dtype=np.float64)
        return sizes[photo.codes] if len(sizes) else np.empty(0)

    @cached_property
    def axes(self) -> FloatArray:
        """Return the directions (photos, 3) in which the photos look, ground coordinates."""
        return -rotation_from_angles(self.solution.photos.values[:, 3:] / DEGREES_PER_RADIAN)[:, :, 2]

    @cached_property
    def depths(self) -> FloatArray:
        """Return the median distance (photos,) of each photo's points along its axis, ground unit; NaN if not known."""
        points, values = self.solution.points.values, self.solution.photos.values
        depth = np.full(len(values), np.nan)
        for row, seen in enumerate(self.seen_points):
            along = (points[seen] - values[row, :3]) @ self.axes[row]
            along = along[np.isfinite(along)]
            if along.size:
                depth[row] = _median(along)
        depth[~(depth > 0.0)] = np.nan
        return depth

    @cached_property
    def seen_points(self) -> tuple[IntArray, ...]:
        """Return the rows of the points that each photo of the solution has, in the order of the points."""
        residuals, photos, points = self.solution.residuals, self.solution.photos.names, self.solution.points.names
        photo_row = {name: row for row, name in enumerate(photos)}
        # x and y are in successive rows
        rows = np.flatnonzero(coded(residuals.kind).where(PHOTO_POINT.name.__eq__))[::2]
        photo = coded(residuals.photo)[rows].places(photo_row)
        point = coded(residuals.point)[rows].places_among(points)
        is_known = (photo >= 0) & (point >= 0)
        # mostly measured in this order, in which a stable sort leaves what is there
        both = np.sort(photo[is_known] * len(points) + point[is_known], kind="stable")
        both = both[np.diff(both, prepend=-1) > 0]
        photo, point = np.divmod(both, max(len(points), 1))
        return tuple(np.split(point, np.searchsorted(photo, np.arange(1, len(photos))))) if photos else ()


def _median(values: FloatArray) -> float:
    """Return the median of finite numbers; for the few of a photo, `np.median` takes several times as long."""
    middle = len(values) // 2
    upper = np.partition(values, middle)
    below = upper[:middle].max() if len(values) % 2 == 0 else upper[middle]
    return float((below + upper[middle]) / 2.0)


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
