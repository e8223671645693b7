"""Where imported photos show imported points: the test that a project was read as it was meant.

A wrong sense or unit of rotations is seen at once: points are behind the camera, or hundreds of pixels away. Where a
format does not say what its angles are, the readings are tried, and the measurements decide.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np
from msgspec import Struct

from orip.arrays import BoolArray, FloatArray, IntArray, rows_of_groups
from orip.exchange.conversion.cameras import ConvertedCamera, directions_of_pixels, pixels_of_directions
from orip.exchange.conversion.poses import described_reading, orip_poses, other_readings
from orip.geometry.perspective import is_in_front
from orip.geometry.rays import intersect_rays
from orip.geometry.rotation import rotated_back
from orip.records.exchanged import ExchangedProject, PoseReading
from orip.wording import counted_names

MOST_TYPICAL_PX = 5.0
"""Median length of the residuals up to which a reading fits."""

MOST_COARSE_PX = 50.0
"""Median up to which a reading that the format declares is taken with a warning: wrong ones are off by hundreds."""

_MOST_BEHIND = 0.1
"""Part of the rays that a reading that fits may have behind the camera, or that meet nowhere."""

_AS_GOOD = 1.5
"""Readings that fit as well up to this factor cannot be told apart."""

_RAYS_TRIED = 20_000
"""Rays by which readings are chosen."""


class Reprojection(Struct, frozen=True, dict=True):
    """How imported photos and points fit the measurements.

    Parameters
    ----------
    reading : PoseReading
        The one that was taken.
    rotations, centres : arrays (n, 3, 3), (n, 3)
        Orip's R and X0 of the photos in that reading.
    residuals : array (k, 2)
        Computed minus measured, pixels; NaN for a ray without a point or photo, or with the point behind.
    is_behind : array (k,) of bool
        The point is behind the camera.
    others : tuple of PoseReading
        Readings that fit as well.
    """

    reading: PoseReading
    rotations: FloatArray
    centres: FloatArray
    residuals: FloatArray
    is_behind: BoolArray
    others: tuple[PoseReading, ...] = ()

    @cached_property
    def lengths(self) -> FloatArray:
        """Return the lengths of the residuals that are known, pixels."""
        with np.errstate(over="ignore"):
            known = np.hypot(*self.residuals.T)
        return np.asarray(known[np.isfinite(known)])

    @property
    def rms(self) -> float:
        """Return the root mean square of the lengths, pixels; NaN without rays."""
        lengths = self.lengths
        with np.errstate(over="ignore"):  # a lens may image points far outside its frame anywhere
            return float(np.sqrt(np.mean(lengths**2))) if lengths.size else np.nan

    @property
    def mean(self) -> float:
        """Return the mean of the lengths, pixels; NaN without rays."""
        with np.errstate(over="ignore"):
            return float(self.lengths.mean()) if self.lengths.size else np.nan

    @property
    def fits(self) -> bool:
        """Return whether the reading can be the right one; without any residual nothing speaks against it."""
        return self._is_within(MOST_TYPICAL_PX)

    @property
    def fits_coarsely(self) -> bool:
        """Return whether the reading may be right and the state of the project is not that of an adjustment."""
        return self._is_within(MOST_COARSE_PX)

    def _is_within(self, most_px: float) -> bool:
        known = np.isfinite(self.residuals).all(axis=1)
        if not known.any() and not self.is_behind.any():
            return True
        if self.is_behind.sum() > _MOST_BEHIND * (known.sum() + self.is_behind.sum()):
            return False
        return bool(self.typical <= most_px)

    @property
    def typical(self) -> float:
        """Return the median of the lengths, pixels; infinite without rays."""
        return float(np.median(self.lengths)) if self.lengths.size else np.inf

    def measurement_error(self, photo: IntArray, point: IntArray) -> float:
        """Return the standard error of an image coordinate, pixels, if poses and points were adjusted to the rays.

        `photo` and `point` (k,) are those of each ray. NaN where no measurement checks another.
        """
        known = np.isfinite(self.residuals).all(axis=1)
        rays = np.bincount(point[known], minlength=1)
        used = known & (rays[np.where(known, point, 0)] >= 2)
        points, photos = len(np.unique(point[used])), len(np.unique(photo[used]))
        redundancy = 2 * int(used.sum()) - 3 * points - 6 * photos
        with np.errstate(over="ignore"):
            squares = float(np.sum(self.residuals[used] ** 2))
        return float(np.sqrt(squares / redundancy)) if redundancy > 0 else np.nan

    def mean_of_points(self, point: IntArray) -> float:
        """Return the mean over points of the mean lengths of their residuals; `point` (k,) is that of each ray."""
        with np.errstate(over="ignore"):
            lengths = np.hypot(*self.residuals.T)
            known = np.isfinite(lengths)
            sums = np.bincount(point[known], lengths[known])
            counts = np.bincount(point[known])
            return float(np.mean(sums[counts > 0] / counts[counts > 0])) if known.any() else np.nan


def said_of_far_rays(project: ExchangedProject, found: Reprojection) -> list[str]:
    """Return what there is to say of single measurements that are far from where their photos show their points."""
    with np.errstate(over="ignore"):
        far = np.flatnonzero(np.hypot(*found.residuals.T) > MOST_COARSE_PX)
    if not len(far) or not found.fits:
        return []
    names = dict.fromkeys(project.points.names[point] for point in project.rays.point[far].tolist())
    photo = project.photos[int(project.rays.photo[far[0]])].name
    text = (
        f"{len(far)} of {len(found.residuals)} measurements are {MOST_COARSE_PX:.0f} px off and more, in photo {photo} "
        f"first: {counted_names('point', list(names))}; check the names, and the order of column and row."
    )
    return [text]


def fitting_reading(
    project: ExchangedProject, cameras: Sequence[ConvertedCamera], pixels: FloatArray
) -> tuple[Reprojection, bool]:
    """Return the reprojection in the reading that fits best, and whether it is one that the format declares.

    The declared readings are tried first, and all that they are easily mistaken for only if none of them fits.

    Parameters
    ----------
    cameras : sequence of ConvertedCamera
        Of the project's cameras, in their order.
    pixels : array (k, 2)
        Measurements as orip counts them.

    Returns
    -------
    Reprojection, bool
        Its `fits` is False where no reading fits; the best of those declared is returned then.
    """
    some = _some_rays(project)
    declared = _best(project, cameras, pixels, project.readings, some)
    if declared is not None:
        return declared, True
    others = dict.fromkeys(other for reading in project.readings for other in other_readings(reading))
    found = _best(project, cameras, pixels, tuple(others), some)
    if found is not None:
        return found, False
    coarse = [reprojection(project, cameras, pixels, reading) for reading in project.readings]
    return min(coarse, key=lambda one: (not one.fits_coarsely, one.typical)), True


def reprojection(
    project: ExchangedProject,
    cameras: Sequence[ConvertedCamera],
    pixels: FloatArray,
    reading: PoseReading,
    chosen: IntArray | None = None,
) -> Reprojection:
    """Return the residuals of rays in a reading; of all rays, or of those chosen by their places.

    Points without coordinates are intersected.
    """
    rotations, centres = orip_poses(project.photos, reading)
    rays = project.rays
    chosen = np.arange(len(rays.photo)) if chosen is None else chosen
    photo, point = rays.photo[chosen], rays.point[chosen]
    camera_of_photo = np.array([p.camera for p in project.photos], dtype=np.int64)
    camera = camera_of_photo[photo] if len(photo) else np.zeros(0, dtype=np.int64)
    measured = pixels[chosen]
    used = rays.is_active[chosen]
    coordinates = project.points.coordinates
    if not np.isfinite(coordinates[point[used]]).all():
        coordinates = with_intersections(
            cameras, camera, measured, coordinates, rotations[photo], centres[photo], point, used
        )
    residuals = np.full((len(photo), 2), np.nan)
    behind = np.zeros(len(photo), dtype=np.bool_)
    with np.errstate(all="ignore"):
        u1, u2, u3 = in_photo_axes(rotations, photo, coordinates[point] - centres[photo])
        known = np.isfinite(u1 + u2 + u3) & used
        in_front: BoolArray = known & np.asarray(is_in_front(u1, u2, u3))
        tangents = np.stack([-u1 / u3, -u2 / u3], axis=1)
    # tangents tell nothing of what a fisheye shows beside and behind it
    fisheye = np.array([converted.camera.projection == "equidistant" for converted in cameras], dtype=bool)
    behind[known & ~in_front & ~fisheye[camera]] = True
    for converted, rows in zip(cameras, rows_of_groups(np.where(in_front, camera, -1), len(cameras)), strict=True):
        residuals[rows] = pixels_of_directions(converted.camera, tangents[rows]) - measured[rows]
    return Reprojection(reading, rotations, centres, residuals, behind)


def in_photo_axes(rotations: FloatArray, photo: IntArray, offset: FloatArray) -> tuple[FloatArray, ...]:
    """Return vectors (k, 3) in the axes of their photos, an array (k,) for each axis.

    `rotations` (n, 3, 3) are those of all photos, `photo` (k,) the photo of each vector.
    """
    return rotated_back(tuple(np.take(rotations.reshape(-1, 9).T, photo, axis=1)), *offset.T)


def said_of_reading(found: Reprojection, *, is_declared: bool) -> str | None:
    """Return a sentence where the reading is not simply the one that the format says; None where it is."""
    if not found.fits:
        return None
    if found.others:
        return (
            f"several readings of the rotations fit equally well; the one used is: {described_reading(found.reading)}; "
            f"it might be: {'; or '.join(described_reading(other) for other in found.others)}"
        )
    if not is_declared:
        return f"the rotations are not what the format says; they fit as: {described_reading(found.reading)}"
    return None


def _best(
    project: ExchangedProject,
    cameras: Sequence[ConvertedCamera],
    pixels: FloatArray,
    readings: Sequence[PoseReading],
    some: IntArray,
) -> Reprojection | None:
    """Return the whole reprojection of the reading that fits best, None where none does."""
    tried = [reprojection(project, cameras, pixels, reading, some) for reading in readings]
    fitting = sorted((one for one in tried if one.fits), key=lambda one: one.typical)
    if not fitting:
        return None
    best = reprojection(project, cameras, pixels, fitting[0].reading)
    if not best.fits:
        return None
    alike = [one for one in fitting[1:] if one.typical <= _AS_GOOD * fitting[0].typical and _differs(one, fitting[0])]
    return Reprojection(
        best.reading,
        best.rotations,
        best.centres,
        best.residuals,
        best.is_behind,
        tuple(one.reading for one in alike),
    )


def _differs(one: Reprojection, other: Reprojection) -> bool:
    """Tell whether two readings give different rotations or centres."""
    return not (
        np.allclose(one.rotations, other.rotations, atol=1e-9, equal_nan=True)
        and np.allclose(one.centres, other.centres, atol=1e-9, equal_nan=True)
    )


def _some_rays(project: ExchangedProject) -> IntArray:
    """Return rays of some points, with all rays of each: points that have none else cannot be intersected."""
    count = len(project.rays.photo)
    if count <= _RAYS_TRIED:
        return np.arange(count)
    every = -(-count // _RAYS_TRIED)
    return np.flatnonzero(project.rays.point % every == 0)


def _ray_directions(cameras: Sequence[ConvertedCamera], camera: IntArray, pixels: FloatArray) -> FloatArray:
    """Return tangents (n, 2), y up, of pixels (n, 2)."""
    found = np.full((len(pixels), 2), np.nan)
    for converted, rows in zip(cameras, rows_of_groups(camera, len(cameras)), strict=True):
        if rows.size:
            found[rows] = directions_of_pixels(converted.camera, pixels[rows])
    return found


def with_intersections(
    cameras: Sequence[ConvertedCamera],
    camera: IntArray,
    pixels: FloatArray,
    coordinates: FloatArray,
    rotations: FloatArray,
    centres: FloatArray,
    point: IntArray,
    used: BoolArray,
) -> FloatArray:
    """Return coordinates (m, 3) of points; those that are not known are intersected.

    Parameters
    ----------
    camera, point : arrays (k,) of int
        Those of each ray.
    pixels : array (k, 2)
    coordinates : array (m, 3)
    rotations, centres : arrays (k, 3, 3), (k, 3)
        Of the photo of each ray.
    used : array (k,) of bool
    """
    tangents = _ray_directions(cameras, camera, pixels)
    vectors = np.column_stack([tangents, np.full(len(tangents), -1.0)])
    ground = np.einsum("nij,nj->ni", rotations, vectors)
    known = used & np.isfinite(ground).all(axis=1) & np.isfinite(centres).all(axis=1)
    found = intersect_rays(centres[known], ground[known], point[known], len(coordinates))
    return np.where(np.isfinite(coordinates).all(axis=1, keepdims=True), coordinates, found)
