"""Photo points outside the frame of their photo, or measured in another unit than its marks."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from orip.arrays import FloatArray, IntArray
from orip.errors import ProjectWarning
from orip.geometry.plane import PlaneTransformation
from orip.interior.definitions import Definitions
from orip.mistakes.mistake import BENT_PICTURES, OTHER_FRAME, declare
from orip.records.camera import Camera, Sensor
from orip.records.coded_names import rows_of_records
from orip.records.measurement import Measured, PhotoObservations
from orip.records.names import record_key
from orip.records.photo import Photo
from orip.wording import counted_names

# No point lies outside the pixels of a sensor, and few lie far outside the fiducial marks of a film camera. Where most
# points of a photo do, they were not measured on this photo, or its marks or its template are not those of the points.

_BEYOND_MARKS = 0.25
"""Margin on each side, as a part of the extent of the fiducial marks: the image may extend beyond them."""

_MOST = 0.5
"""Part of a photo's points outside the marks from which the photo is wrong, and not single points."""

_FAR = 2.0
"""Margin from which a single point cannot be on the film, as part of the extent of the fiducial marks."""

_FEW = 0.2
"""Largest part of the photos of a camera that are turned by mistake; of more, columns and rows are exchanged in all."""

_SOME = 0.5
"""Part of the photos of a camera up to which they may be those of another one, or of another lens."""

_FULL = 0.9
"""Part of the picture that points reach at least if they were measured all over it."""

TURNED_SENSOR = "; none would if columns and rows were exchanged"

_OUTSIDE = declare("outside-frame", "", OTHER_FRAME, explains_misfit=True)
STRAY_POINTS = "points-outside"
"""Code of the warning that some points of one photo lie outside, which further adjustments may explain."""

_FEWEST_PHOTOS = 3
"""Photos of a camera of which one is unlike the others."""

_PIXEL = 1.0
"""Tolerance at the edge of a sensor, pixels: some programs count from the centre of the first one."""


def points_outside_frames(
    definitions: Definitions, observations: PhotoObservations, to_photo: Mapping[str, PlaneTransformation]
) -> list[ProjectWarning]:
    """Return a warning for each photo and camera whose points lie outside.

    Parameters
    ----------
    observations : PhotoObservations
        Of one bundle.
    to_photo : mapping by `record_key` of the photo
        Stored coordinates to photo millimetres.
    """
    rows = rows_of_records(observations.photos)
    points = {key: observations.measured[own] for key, own in rows.items() if key in definitions.photos}
    photos = [definitions.photos[key] for key in points]
    on_sensors = [photo for photo in photos if definitions.camera_of(photo).sensor]
    on_film = [
        photo for photo in photos if definitions.camera_of(photo).fiducials and record_key(photo.name) in to_photo
    ]
    return [
        *_off_sensors(definitions, on_sensors, points),
        *_off_films(definitions, on_film, points, to_photo),
        *_beside_frames(definitions, on_film, points, to_photo),
        *_far_points(definitions, on_film, rows, observations, to_photo),
    ]


def _off_sensors(
    definitions: Definitions, photos: list[Photo], points: Mapping[str, FloatArray]
) -> Iterator[ProjectWarning]:
    by_camera: dict[str, list[Photo]] = {}
    for photo in photos:
        by_camera.setdefault(record_key(photo.camera), []).append(photo)
    for key, of_camera in by_camera.items():
        sensor = definitions.cameras[key].sensor
        assert sensor is not None
        size = np.array([sensor.columns, sensor.rows], dtype=np.float64)
        off = [photo.name for photo in of_camera if _off(points[record_key(photo.name)], size).any()]
        if not off:
            continue
        if len(off) <= max(1.0, _FEW * len(of_camera)) and _are_turned(off, points, size):
            yield from _in_portrait(off, points, size)
            continue
        if len(off) == 1 and len(of_camera) >= _FEWEST_PHOTOS:
            outside = _off(points[record_key(off[0])], size)
            if np.mean(outside) < _MOST:
                yield _stray_points(off[0], outside, sensor)
                continue
        xy = np.vstack([points[record_key(photo.name)] for photo in of_camera])
        text = (
            f"{_count(_off(xy, size))} lie outside the {sensor.columns} columns and {sensor.rows} rows of the sensor "
            f"({counted_names('photo', off)})"
        )
        if not _off(xy, size[::-1]).any():
            sides = "" if _has_sides_of_turned(sensor) else " (and width and height)"
            text += (
                f"{TURNED_SENSOR}: write the column first in the measurements, or exchange columns and rows{sides} of "
                "the sensor"
            )
        elif factor := _reduced_by(xy, size):
            text += (
                f"; they do not if it has {factor} times as many: columns and rows seem to be those of reduced "
                f"pictures; write columns = {factor * sensor.columns}, rows = {factor * sensor.rows}"
            )
        else:
            # photos of another lens may reach beyond the pictures of the first
            lens = " and lens, with the same zoom" if len(off) <= _SOME * len(of_camera) else ""
            text += (
                "; check columns and rows of the sensor, and whether the photos are uncropped ones of this camera"
                f"{lens}"
            )
        yield ProjectWarning(_OUTSIDE, f"camera {definitions.cameras[key].name}", text)


def _stray_points(photo: str, outside: NDArray[np.bool_], sensor: Sensor) -> ProjectWarning:
    lie = "lies" if np.count_nonzero(outside) == 1 else "lie"
    text = (
        f"{_count(outside)} {lie} outside the {sensor.columns} columns and {sensor.rows} rows of the sensor, and none "
        "of the other photos': measured wrong, or the photo was taken with another zoom or lens, or its picture was "
        "enlarged or cropped; measure them again, give the photo a [[camera]] of its own, or leave it out"
    )
    return ProjectWarning(STRAY_POINTS, f"photo {photo}", text)


def _has_sides_of_turned(sensor: Sensor) -> bool:
    """Tell whether width and height are those of pictures with columns and rows exchanged."""
    sides = sensor.width / sensor.height
    pixels, turned = sides * sensor.rows / sensor.columns, sides * sensor.columns / sensor.rows
    return bool(abs(np.log(turned)) < abs(np.log(pixels)))


def _reduced_by(xy: FloatArray, size: FloatArray) -> int:
    """Return by which whole number columns and rows of a sensor are too small for what was measured; 0 for none."""
    reach = np.max(xy, axis=0) / size
    factor = int(np.ceil(reach.max() - _PIXEL / size.max()))
    full = factor > 1 and reach.min() > _FULL * factor and not _off(xy, factor * size).any()
    return factor if full else 0


def _are_turned(off: list[str], points: Mapping[str, FloatArray], size: FloatArray) -> bool:
    """Tell whether no point of some photos lies outside if the photos are turned by 90 degrees."""
    return not any(_off(points[record_key(name)], size[::-1]).any() for name in off)


def _in_portrait(off: list[str], points: Mapping[str, FloatArray], size: FloatArray) -> Iterator[ProjectWarning]:
    for name in off:
        text = (
            f"{_count(_off(points[record_key(name)], size))} lie outside the {size[0]:.0f} columns and {size[1]:.0f} "
            "rows of the sensor, and none would in portrait format, unlike the other photos: its picture seems to be "
            "turned by 90 degrees (or its columns and rows are exchanged); turn it as the others are, and measure it "
            "again"
        )
        yield ProjectWarning(_OUTSIDE, f"photo {name}", text)


def _off(pixels: FloatArray, size: FloatArray) -> NDArray[np.bool_]:
    return np.asarray(((pixels < -_PIXEL) | (pixels > size + _PIXEL)).any(axis=1))


def _off_films(
    definitions: Definitions,
    photos: list[Photo],
    points: Mapping[str, FloatArray],
    to_photo: Mapping[str, PlaneTransformation],
) -> Iterator[ProjectWarning]:
    found: dict[tuple[str, str], list[str]] = {}
    for photo in photos:
        key, camera = record_key(photo.name), definitions.camera_of(photo)
        outside = _beyond_marks(to_photo[key].apply(points[key]), camera)
        if np.mean(outside) <= _MOST:
            continue
        there = [
            other.name
            for other in photos
            if other is not photo
            and other.template == photo.template
            and _are_in(points[key], other, to_photo, camera)
            and _are_in(points[record_key(other.name)], photo, to_photo, camera)
        ]
        if len(there) == 1:
            text = (
                f"{_count(outside)} lie outside its fiducial marks, but within those of photo {there[0]}, and those of "
                f"{there[0]} within its own: the two are exchanged; exchange the names in the POINTS lines"
            )
            yield ProjectWarning(_OUTSIDE, f"photo {photo.name}", text)
        else:
            found.setdefault((photo.template or "", record_key(photo.camera)), []).append(photo.name)
    for (template, _), names in found.items():
        where = counted_names("photo", names)
        cause = (
            f"template {template} was not mounted as its tick marks were measured, or fiducial marks or points are "
            "those of another photo; measure the tick marks again"
            if template
            else "fiducial marks or points are those of another photo or mounting; measure the fiducial marks again"
        )
        yield ProjectWarning(_OUTSIDE, where, f"most of the points lie outside the fiducial marks: {cause}")


_AT_EDGE, _PART = 0.02, 0.1
"""Margin at the edge of a film, as part of the extent of its marks, and the part of a photo's points beyond it from
which the photo is displaced, where those of most other photos all lie within."""


def _beside_frames(
    definitions: Definitions,
    photos: list[Photo],
    points: Mapping[str, FloatArray],
    to_photo: Mapping[str, PlaneTransformation],
) -> Iterator[ProjectWarning]:
    """Yield a warning for the photos of a camera whose points are displaced, unlike those of its other photos."""
    by_camera: dict[str, list[tuple[Photo, NDArray[np.bool_]]]] = {}
    for photo in photos:
        key, camera = record_key(photo.name), definitions.camera_of(photo)
        outside = _beyond_marks(to_photo[key].apply(points[key]), camera, _AT_EDGE)
        by_camera.setdefault(record_key(photo.camera), []).append((photo, outside))
    for of_camera in by_camera.values():
        within = sum(not outside.any() for _, outside in of_camera)
        displaced = [(photo, outside) for photo, outside in of_camera if _PART < np.mean(outside) <= _MOST]
        templates = sorted({photo.template for photo, _ in displaced if photo.template})
        if not templates or within < max(_FEWEST_PHOTOS, 0.5 * len(of_camera)):
            continue
        number = sum(int(np.count_nonzero(outside)) for _, outside in displaced)
        text = (
            f"{number} of their points lie outside their fiducial marks, unlike those of the other photos: they were "
            f"measured in another mounting than their marks; check that the tick marks of "
            f"{counted_names('template', templates)} were measured at each mounting, and under the right name"
        )
        yield ProjectWarning(_OUTSIDE, counted_names("photo", [photo.name for photo, _ in displaced]), text)


EXCHANGED_TEMPLATES = declare("exchanged-templates", "", BENT_PICTURES, explains_misfit=True)


def exchanged_templates(definitions: Definitions, measured: Measured) -> Iterator[ProjectWarning]:
    """Yield a warning for each two templates of which each was measured on the stage that the other is on."""
    on_other = [
        template
        for key, template in definitions.templates.items()
        if key in measured.templates and template.stage and measured.templates[key].stage != template.stage
    ]
    for one, other in combinations(on_other, 2):
        if one.temtick != other.temtick or one.stage == other.stage:
            continue
        text = (
            f"the tick marks of {one.name} were measured on stage {other.stage}, which orip.toml has for {other.name}, "
            f"and those of {other.name} on {one.stage}: exchange the names in the TEMPLATE lines of the measurements "
            "(or stage in their [[template]], if the sheets did lie so)"
        )
        yield ProjectWarning(EXCHANGED_TEMPLATES, f"templates {one.name} and {other.name}", text)


def _far_points(
    definitions: Definitions,
    photos: list[Photo],
    rows: Mapping[str, IntArray],
    observations: PhotoObservations,
    to_photo: Mapping[str, PlaneTransformation],
) -> Iterator[ProjectWarning]:
    """Return a warning for each photo of which single points are nowhere near the film."""
    for photo in photos:
        key, camera = record_key(photo.name), definitions.camera_of(photo)
        xy = to_photo[key].apply(observations.measured[rows[key]])
        if np.mean(_beyond_marks(xy, camera)) > _MOST:
            continue
        far = np.flatnonzero(_beyond_marks(xy, camera, _FAR))
        if len(far):
            names = counted_names("point", [observations.points[rows[key][row]] for row in far])
            x, y = xy[far[0]]
            place = f"x {x:.4g}, y {y:.4g} mm"
            text = f"{names} of this photo cannot be on the film ({place}); check the columns of the line: name, x, y"
            yield ProjectWarning(_OUTSIDE, f"photo {photo.name}", text)


def _are_in(stored: FloatArray, photo: Photo, to_photo: Mapping[str, PlaneTransformation], camera: Camera) -> bool:
    return float(np.mean(_beyond_marks(to_photo[record_key(photo.name)].apply(stored), camera))) <= 1.0 - _MOST


def _beyond_marks(xy: FloatArray, camera: Camera, margin_part: float = _BEYOND_MARKS) -> NDArray[np.bool_]:
    marks = np.array([(mark.x, mark.y) for mark in camera.fiducials])
    low, high = marks.min(axis=0), marks.max(axis=0)
    margin = margin_part * (high - low).max()
    return np.asarray(((xy < low - margin) | (xy > high + margin)).any(axis=1))


def _count(outside: NDArray[np.bool_]) -> str:
    return f"{np.count_nonzero(outside)} of {len(outside)} points"


POINT_UNIT = declare("point-unit", explains_misfit=True)

_FEWEST = 4
"""Points of a photo that show how far its image extends."""

_LARGE = 50.0
"""Ratio of the extents of points and marks that no mounting and no clustered points make, but a factor of 1000 does."""


def points_in_another_unit(
    definitions: Definitions, observations: PhotoObservations, to_photo: Mapping[str, PlaneTransformation]
) -> Iterator[ProjectWarning]:
    """Yield a warning for the photos of each camera whose points were measured in another unit than their marks.

    Parameters are those of `points_outside_frames`.
    """
    found: dict[tuple[str, bool], list[str]] = {}
    counts: dict[str, int] = {}
    for key, rows in rows_of_records(observations.photos).items():
        photo = definitions.photos.get(key)
        if photo is None or key not in to_photo or len(rows) < _FEWEST:
            continue
        camera = definitions.camera_of(photo)
        if not camera.fiducials:
            continue
        marks = np.ptp([(mark.x, mark.y) for mark in camera.fiducials], axis=0).max()
        points = np.ptp(to_photo[key].apply(observations.measured[rows]), axis=0).max()
        counts[camera.name] = counts.get(camera.name, 0) + 1
        if points > _LARGE * marks or _LARGE * points < marks:
            found.setdefault((camera.name, bool(points > marks)), []).append(photo.name)
    for (camera_name, are_large), names in found.items():
        where = f"camera {camera_name}" if len(names) == counts[camera_name] else counted_names("photo", names)
        smaller, larger = ("POINTS", "PHOTO") if are_large else ("PHOTO", "POINTS")
        text = (
            f"the points extend over {'far more than' if are_large else 'next to nothing of'} what the fiducial marks "
            f"enclose: the {smaller} lines seem to be in micrometres, and the {larger} lines in mm; measure both in "
            "one unit"
        )
        yield ProjectWarning(POINT_UNIT, where, text)
