"""Photo points outside the frame of their photo, and marks with exchanged names."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from orip.arrays import FloatArray, IntArray
from orip.errors import ProjectWarning
from orip.geometry.plane import MARKS_NEEDED, PARAMETERS, PlaneTransformation
from orip.interior.definitions import Definitions
from orip.records.camera import Camera, Sensor
from orip.records.coded_names import rows_of_records
from orip.records.interior import MarkAdjustment
from orip.records.measurement import PhotoObservations
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

_PIXEL = 1.0
"""Tolerance at the edge of a sensor, pixels: some programs count from the centre of the first one."""


def points_outside_frames(
    definitions: Definitions, observations: PhotoObservations, to_photo: Mapping[str, PlaneTransformation]
) -> list[ProjectWarning]:
    """Return a warning for each photo and camera whose points lie outside.

    Parameters
    ----------
    definitions : Definitions
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
        yield ProjectWarning("outside-frame", f"camera {definitions.cameras[key].name}", text)


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
        yield ProjectWarning("outside-frame", f"photo {name}", text)


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
            yield ProjectWarning("outside-frame", f"photo {photo.name}", text)
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
        yield ProjectWarning("outside-frame", where, f"most of the points lie outside the fiducial marks: {cause}")


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
            yield ProjectWarning("outside-frame", f"photo {photo.name}", text)


def _are_in(stored: FloatArray, photo: Photo, to_photo: Mapping[str, PlaneTransformation], camera: Camera) -> bool:
    return float(np.mean(_beyond_marks(to_photo[record_key(photo.name)].apply(stored), camera))) <= 1.0 - _MOST


def _beyond_marks(xy: FloatArray, camera: Camera, margin_part: float = _BEYOND_MARKS) -> NDArray[np.bool_]:
    marks = np.array([(mark.x, mark.y) for mark in camera.fiducials])
    low, high = marks.min(axis=0), marks.max(axis=0)
    margin = margin_part * (high - low).max()
    return np.asarray(((xy < low - margin) | (xy > high + margin)).any(axis=1))


def _count(outside: NDArray[np.bool_]) -> str:
    return f"{np.count_nonzero(outside)} of {len(outside)} points"


# Marks named by their position in the scan fit nearly as well as under their own names, because the four corners of a
# frame are nearly symmetrical. But no camera and no template is perfectly symmetrical: the given coordinates fit best
# under the right names. So the marks are named in every order that a rotation or a reflection of the film would give,
# and the residuals are compared with those of the other films.

_UNLIKELY = 1e-6
"""Probability of such large residuals by chance below which names are doubted; there is one test for each film."""

_LIKELY = 1e-3
"""Probability of the residuals above which marks fit under these names."""

_STRETCHED = 1.2
"""Ratio of the scales in x and y that no film or enlargement reaches: an upright frame was stretched into a landscape
one."""

_LISTED = 4
"""Most marks that a message lists."""


class _Order(Struct, frozen=True):
    """Which mark each one would be, and whether the film would have to be turned over."""

    marks: IntArray
    turned_over: bool


class _Film(Struct, frozen=True):
    """Square sums (mm²) of the residuals under the names given, and under those that fit best."""

    adjustment: MarkAdjustment
    given: float
    best: float
    order: _Order

    @property
    def redundancy(self) -> int:
        return self.adjustment.summary.redundancy


def misnamed_marks(adjustments: Sequence[MarkAdjustment]) -> list[ProjectWarning]:
    """Return warnings for templates and photos whose marks fit with exchanged names, and not with their own.

    Parameters
    ----------
    adjustments : sequence of MarkAdjustment
        Of all templates and photos: together they tell how well marks fit.
    """
    films = [film for adjustment in adjustments if (film := _film(adjustment)) is not None]
    found: dict[tuple[str, str], list[_Film]] = {}
    for film in films:
        if _is_misnamed(film, films):
            found.setdefault((film.adjustment.summary.group, _finding(film)), []).append(film)
    most_first = sorted(found.items(), key=lambda item: -len(item[1]))
    return [_warning(group, finding, alike) for (group, finding), alike in most_first]


def _film(adjustment: MarkAdjustment) -> _Film | None:
    used = ~adjustment.marks.disregarded
    measured, given = adjustment.marks.measured[used], adjustment.given[used]
    if len(measured) <= MARKS_NEEDED[adjustment.kind]:
        return None
    sums = [
        (_square_sum(adjustment.kind, measured, given[order.marks], order.turned_over), order)
        for order in _orders(given)
    ]
    (as_given, _), *_ = sums
    best, order = min(sums, key=lambda pair: pair[0])
    return _Film(adjustment, as_given, best, order)


def _orders(given: FloatArray) -> Iterator[_Order]:
    """Yield the orders in which the marks around a film may be named; the one as given first."""
    centred = given - given.mean(axis=0)
    around = np.argsort(np.arctan2(centred[:, 1], centred[:, 0]))
    count = len(given)
    for turned_over in (False, True):
        for shift in range(count):
            marks = np.empty(count, dtype=np.int64)
            marks[around] = around[(shift + (-1 if turned_over else 1) * np.arange(count)) % count]
            yield _Order(marks, turned_over)


def _square_sum(kind: str, measured: FloatArray, given: FloatArray, turned_over: bool) -> float:
    """Return the square sum of residuals of a transformation; infinite where it would have to stretch the film."""
    centred, target = measured - measured.mean(axis=0), given - given.mean(axis=0)
    if kind == "A":
        matrix, *_ = np.linalg.lstsq(centred, target, rcond=None)
        scales = np.hypot(*matrix)
        if not 1.0 / _STRETCHED < scales[0] / scales[1] < _STRETCHED:
            return np.inf
        return float(np.sum((centred @ matrix - target) ** 2))
    if turned_over:
        centred = centred * [-1.0, 1.0]
    a, b = centred @ [1.0, 1j], target @ [1.0, 1j]
    factor = np.vdot(a, b) / np.vdot(a, a)
    if kind == "W":
        factor /= abs(factor)
    return float(np.sum(np.abs(factor * a - b) ** 2))


def _is_misnamed(film: _Film, films: Sequence[_Film]) -> bool:
    from scipy.special import fdtrc  # takes its time; most commands do without

    if film.best >= film.given:
        return False
    if not np.isfinite(film.given):
        return True
    others = [other for other in films if other is not film]
    noise = float(np.median([other.best / other.redundancy for other in others])) if others else 0.0
    if noise <= 0.0:
        return False
    freedom = sum(other.redundancy for other in others)
    as_given, best = (
        float(fdtrc(film.redundancy, freedom, square_sum / film.redundancy / noise))
        for square_sum in (film.given, film.best)
    )
    return as_given < _UNLIKELY and best > _LIKELY


def _finding(film: _Film) -> str:
    """Return how the film probably lay, and which marks are meant."""
    used = np.flatnonzero(~film.adjustment.marks.disregarded)
    names = [film.adjustment.marks.names[row] for row in used]
    pairs = [f"{name} is {names[row]}" for name, row in zip(names, film.order.marks, strict=True) if names[row] != name]
    listed = ", ".join(pairs[:_LISTED]) + (", …" if len(pairs) > _LISTED else "")
    return f"lay {_how(film, used)} and its marks were named by where they lay: {listed}"


def _warning(group: str, finding: str, films: Sequence[_Film]) -> ProjectWarning:
    owner, what, marks = ("template", "template", "tick") if group == "templates" else ("photo", "film", "fiducial")
    names = [film.adjustment.summary.name for film in films]
    first = films[0]
    text = (
        f"the {marks} marks do not fit as they are named ({_rms(first.given, first)} mm), but they would "
        f"({_rms(first.best, first)} mm) if the {what} {finding}; give marks the names that they have on the {what}"
    )
    return ProjectWarning("misnamed-marks", counted_names(owner, names), text)


def _how(film: _Film, used: IntArray) -> str:
    """Return how the film probably lay."""
    given = film.adjustment.given[used]
    if film.order.turned_over:
        return "upside down (a mirror image, as of a scan with the emulsion up)"
    a, b = (given - given.mean(axis=0)) @ [1.0, 1j], (given[film.order.marks] - given.mean(axis=0)) @ [1.0, 1j]
    turn = round(float(np.degrees(np.angle(np.vdot(b, a)))) / 90.0) * 90 % 360
    return f"turned by {turn}°" if turn else "turned"


def _rms(square_sum: float, film: _Film) -> str:
    if not np.isfinite(square_sum):
        square_sum = float(np.sum(film.adjustment.residuals[~film.adjustment.marks.disregarded] ** 2))
    freedom = 2 * int(np.count_nonzero(~film.adjustment.marks.disregarded)) - PARAMETERS[film.adjustment.kind]
    return f"{np.sqrt(square_sum / freedom):.3g}"
