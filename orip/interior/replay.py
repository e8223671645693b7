"""Replaying a measurement log: what the records, one after the other, leave measured.

Photo and point measurements are kept in template coordinates (plate coordinates off a template, pixels of a digital
frame), so that a template mounted again is oriented anew by its ticks alone. A photo off a template that is mounted
again takes its earlier points and marks along: old plate to photo to new plate.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from orip.errors import Complaint, ProjectWarning
from orip.geometry.plane import IDENTITY, PlaneTransformation
from orip.interior.fiducial_system import fiducials_from_plate
from orip.interior.orientation import (
    OrientationError,
    given_coordinates,
    orient_photo,
    orient_template,
    scan_transformation,
    transformation_without_marks,
)
from orip.model.camera import Camera, Mark
from orip.model.measurement import (
    EditRecord,
    FiducialsRecord,
    LogRecord,
    MeasuredMarks,
    PhotoObservations,
    PhotoOrientation,
    PhotoRecord,
    Place,
    PointsRecord,
    TemplateOrientation,
    TemplateRecord,
    TicksRecord,
)
from orip.model.names import record_key
from orip.model.photo import Photo, Scan, Template, Temtick

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Definitions:
    """The records that a log refers to, by `record_key` of their names; `bundles` are names alone."""

    cameras: Mapping[str, Camera]
    temticks: Mapping[str, Temtick]
    templates: Mapping[str, Template]
    photos: Mapping[str, Photo]
    bundles: Mapping[str, str]


@dataclass(frozen=True, slots=True)
class Measured:
    """What is measured: orientations by `record_key`, observations by bundle, digitised marks taken into records."""

    templates: dict[str, TemplateOrientation] = field(default_factory=dict)
    photos: dict[str, PhotoOrientation] = field(default_factory=dict)
    observations: dict[str, PhotoObservations] = field(default_factory=dict)
    cameras: dict[str, Camera] = field(default_factory=dict)
    temticks: dict[str, Temtick] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Replayed:
    """The outcome of a replay: what is measured, what was wrong, what to know, and how many points came again."""

    measured: Measured
    complaints: tuple[Complaint, ...]
    warnings: tuple[ProjectWarning, ...]
    remeasured: int


class _PhotoPoint(NamedTuple):
    x: float
    y: float
    x_error: float
    y_error: float
    disregarded: bool


_PointsOfPhoto = dict[str, _PhotoPoint]


def replay(records: Iterable[LogRecord], definitions: Definitions, start: Measured) -> Replayed:
    """Replay log records on top of what is already measured.

    Parameters
    ----------
    records : iterable of LogRecord
        In the order of the log.
    definitions : Definitions
    start : Measured
        What the stores hold; empty to replay from the beginning.

    Returns
    -------
    Replayed
        With complaints, `measured` is not to be kept.
    """
    state = _Replay(definitions, start)
    for record in records:
        state.take(record)
    state.check_photo_orientations()
    return Replayed(state.result(), tuple(state.complaints), tuple(state.warnings), state.remeasured)


class _Replay:
    """The replay in hand."""

    def __init__(self, definitions: Definitions, start: Measured) -> None:
        self.definitions = definitions
        self.templates = dict(start.templates)
        self.photos = dict(start.photos)
        self.cameras = dict(definitions.cameras) | start.cameras
        self.temticks = dict(definitions.temticks) | start.temticks
        self.digitised_cameras = dict(start.cameras)
        self.digitised_temticks = dict(start.temticks)
        self.points = {bundle: _points_by_photo(each) for bundle, each in start.observations.items()}
        self.plate_to_template: dict[str, PlaneTransformation] = {}
        self.photo_places: dict[str, Place] = {}
        self.complaints: list[Complaint] = []
        self.warnings: list[ProjectWarning] = []
        self.remeasured = 0

    def take(self, record: LogRecord) -> None:
        """Take one record into the state."""
        match record:
            case TemplateRecord():
                self._mount_template(record)
            case PhotoRecord():
                self._measure_photo(record)
            case PointsRecord():
                self._measure_points(record)
            case EditRecord():
                self._edit(record)
            case FiducialsRecord():
                self._digitise_fiducials(record)
            case TicksRecord():
                self._digitise_ticks(record)

    def _complain(self, place: Place, message: str) -> None:
        self.complaints.append(Complaint(message, place.path, place.line))

    def _warn(self, place: Place, code: str, text: str) -> None:
        self.warnings.append(ProjectWarning(code, f"{place.path}:{place.line}", text))

    # templates

    def _mount_template(self, record: TemplateRecord) -> None:
        key = record_key(record.template)
        template = self.definitions.templates.get(key)
        if template is None:
            self._complain(record.place, _unknown("template", record.template, self.definitions.templates.values()))
            return
        marks = _in_plate_millimetres(record.marks, template.scan)
        orientation = TemplateOrientation(template.name, record.transformation, record.stage or template.stage, marks)
        try:
            self._template_transformation(key, orientation)
        except OrientationError as error:
            self._complain(record.place, str(error))
            return
        self.templates[key] = orientation

    def _template_transformation(self, key: str, orientation: TemplateOrientation) -> PlaneTransformation:
        temtick = self.temticks[record_key(self.definitions.templates[key].temtick)]
        oriented = orient_template(orientation, temtick.ticks)
        self.plate_to_template[key] = oriented.transformation
        return oriented.transformation

    # photos

    def _measured_to_stored(self, photo: Photo, place: Place) -> PlaneTransformation | None:
        """Return the transformation of a photo's log coordinates to those that are kept; None after a complaint."""
        if photo.template is None:
            return scan_transformation(photo.scan) if photo.scan else IDENTITY
        key = record_key(photo.template)
        scan = photo.scan or self.definitions.templates[key].scan
        if key not in self.templates:
            self._complain(
                place,
                f"photo {photo.name} is on template {photo.template}, which is not oriented yet; "
                f"measure its tick marks first (TEMPLATE {photo.template} A ...)",
            )
            return None
        if key not in self.plate_to_template:
            self._template_transformation(key, self.templates[key])
        transformation = self.plate_to_template[key]
        return transformation.after(scan_transformation(scan)) if scan else transformation

    def _known_photo(self, name: str, place: Place) -> Photo | None:
        photo = self.definitions.photos.get(record_key(name))
        if photo is None:
            self._complain(place, _unknown("photo", name, self.definitions.photos.values()))
        return photo

    def _measure_photo(self, record: PhotoRecord) -> None:
        photo = self._known_photo(record.photo, record.place)
        if photo is None:
            return
        key, camera = record_key(photo.name), self.cameras[record_key(photo.camera)]
        if camera.sensor is not None:
            message = (
                f"photo {photo.name} is a digital frame (camera {camera.name} has a sensor) and has no fiducial marks; "
                "take this PHOTO record out, or give the camera fiducials instead of the sensor"
            )
            self._complain(record.place, message)
            return
        to_stored = self._measured_to_stored(photo, record.place)
        if to_stored is None:
            return
        marks = replace(record.marks, measured=to_stored.apply(record.marks.measured))
        try:
            given_coordinates(marks, camera.fiducials, f"camera {camera.name}")
        except OrientationError as error:
            self._complain(record.place, f"photo {photo.name}: {error}")
            return
        orientation = PhotoOrientation(photo.name, record.transformation, marks)
        if key in self.photos and photo.template is None:
            orientation = self._mount_photo_again(photo, camera, orientation, record.place)
        self.photos[key] = orientation
        self.photo_places[key] = record.place

    def _mount_photo_again(self, photo: Photo, camera: Camera, new: PhotoOrientation, place: Place) -> PhotoOrientation:
        """Take the earlier points and marks of a photo off a template along to its new place on the plate."""
        old = self.photos[record_key(photo.name)]
        try:
            to_photo = orient_photo(old, camera, on_template=False).transformation
            to_plate = orient_photo(new, camera, on_template=False).transformation.inverse()
        except OrientationError as error:
            self._complain(place, f"photo {photo.name} is mounted again, but its points cannot follow: {error}")
            return new
        moved = to_plate.after(to_photo)
        for points in self.points.values():
            if record_key(photo.name) in points:
                points[record_key(photo.name)] = _moved_points(points[record_key(photo.name)], moved)
        # an earlier mark that was not measured again is carried along, but has no say in the new orientation
        kept = [row for row, name in enumerate(old.marks.names) if name not in new.marks.names]
        return replace(
            new,
            marks=MeasuredMarks(
                new.marks.names + tuple(old.marks.names[row] for row in kept),
                np.vstack([new.marks.measured, moved.apply(old.marks.measured[kept])]),
                np.append(new.marks.disregarded, np.ones(len(kept), dtype=bool)),
                np.vstack([new.marks.given, old.marks.given[kept]]),
            ),
        )

    def check_photo_orientations(self) -> None:
        """Complain of every photo whose marks, after all edits, do not orient it."""
        for key, orientation in self.photos.items():
            photo = self.definitions.photos.get(key)
            if photo is None:
                continue
            camera = self.cameras[record_key(photo.camera)]
            if transformation_without_marks(camera) is not None and not len(orientation.marks.names):
                continue
            try:
                orient_photo(orientation, camera, photo.template is not None)
            except OrientationError as error:
                place = self.photo_places.get(key)
                self.complaints.append(
                    Complaint(str(error), place.path if place else "", place.line if place else None)
                )

    # points

    def _measure_points(self, record: PointsRecord) -> None:
        bundle = self.definitions.bundles.get(record_key(record.bundle))
        if bundle is None:
            names = ", ".join(self.definitions.bundles.values())
            self._complain(record.place, f"bundle {record.bundle} is not defined; known are: {names}")
        photo = self._known_photo(record.photo, record.place)
        if bundle is None or photo is None:
            return
        camera = self.cameras[record_key(photo.camera)]
        to_stored = IDENTITY if camera.sensor is not None else self._measured_to_stored(photo, record.place)
        errors = self._errors_in_millimetres(record, photo, camera)
        if to_stored is None or errors is None:
            return
        points = self.points.setdefault(record_key(bundle), {}).setdefault(record_key(photo.name), {})
        stored = to_stored.apply(record.measured)
        for name, (x, y), (x_error, y_error), disregarded in zip(
            record.names, stored.tolist(), errors.tolist(), record.disregarded.tolist(), strict=True
        ):
            self.remeasured += name in points
            points[name] = _PhotoPoint(x, y, x_error, y_error, disregarded)

    def _errors_in_millimetres(self, record: PointsRecord, photo: Photo, camera: Camera) -> FloatArray | None:
        if not record.errors_in_pixels.any():
            return record.errors
        pixel = pixel_size(photo, camera, self._template_of(photo))
        if pixel is None:
            line = int(record.lines[record.errors_in_pixels.any(axis=1)][0])
            message = f"an a-priori error in px needs a sensor or scan, and photo {photo.name} has neither; write mm"
            self._complain(Place(record.place.path, line), message)
            return None
        return np.where(record.errors_in_pixels, record.errors * np.array(pixel), record.errors)

    def _template_of(self, photo: Photo) -> Template | None:
        return self.definitions.templates[record_key(photo.template)] if photo.template else None

    # edits

    def _edit(self, record: EditRecord) -> None:
        count = self._edit_points(record) if record.what == "POINT" else self._edit_marks(record)
        if not count:
            what = record.what.lower()
            self._warn(
                record.place, "nothing-to-edit", f"{record.action} finds no {what} {record.name} of {record.owner}"
            )

    def _edit_points(self, record: EditRecord) -> int:
        by_photo = self.points.get(record_key(record.bundle or ""), {})
        owners = by_photo if record.owner == "*" else [record_key(record.owner)]
        count = 0
        for owner in owners:
            points = by_photo.get(owner, {})
            for name in [name for name in points if record.name in ("*", name)]:
                count += 1
                if record.action == "KILL":
                    del points[name]
                else:
                    points[name] = points[name]._replace(disregarded=record.action == "DISREGARD")
        return count

    def _edit_marks(self, record: EditRecord) -> int:
        count = 0
        if record.what == "TICK":
            for key, template in list(self.templates.items()):
                if record.owner in ("*",) or record_key(record.owner) == key:
                    marks, edited = _edited_marks(template.marks, record)
                    self.templates[key] = replace(template, marks=marks)
                    count += edited
                    self._reorient_template(key, record.place)
            return count
        for key, photo in list(self.photos.items()):
            if record.owner in ("*",) or record_key(record.owner) == key:
                marks, edited = _edited_marks(photo.marks, record)
                self.photos[key] = replace(photo, marks=marks)
                self.photo_places.setdefault(key, record.place)
                count += edited
        return count

    def _reorient_template(self, key: str, place: Place) -> None:
        try:
            self._template_transformation(key, self.templates[key])
        except OrientationError as error:
            self._complain(place, str(error))

    # digitised marks

    def _digitise_fiducials(self, record: FiducialsRecord) -> None:
        key = record_key(record.camera)
        if key not in self.cameras:
            self._complain(record.place, _unknown("camera", record.camera, self.cameras.values()))
            return
        try:
            fiducials = fiducials_from_plate(record.marks, record.arrangement)
        except ValueError as error:
            self._complain(record.place, f"fiducials of camera {record.camera}: {error}")
            return
        self.cameras[key] = self.digitised_cameras[key] = replace(self.cameras[key], fiducials=fiducials)

    def _digitise_ticks(self, record: TicksRecord) -> None:
        key = record_key(record.temtick)
        if key not in self.temticks:
            self._complain(record.place, _unknown("temtick", record.temtick, self.temticks.values()))
            return
        ticks = tuple(
            Mark(name, float(x), float(y))
            for name, (x, y) in zip(record.marks.names, record.marks.measured, strict=True)
        )
        self.temticks[key] = self.digitised_temticks[key] = replace(self.temticks[key], ticks=ticks)

    def result(self) -> Measured:
        """Return what is measured, photos in the order of their definition."""
        order = {key: place for place, key in enumerate(self.definitions.photos)}
        observations = {
            bundle: _observations(self.definitions.bundles[bundle], by_photo, self.definitions.photos, order)
            for bundle, by_photo in self.points.items()
            if bundle in self.definitions.bundles
        }
        return Measured(self.templates, self.photos, observations, self.digitised_cameras, self.digitised_temticks)


def pixel_size(photo: Photo, camera: Camera, template: Template | None) -> tuple[float, float] | None:
    """Return the pixel size (mm, x and y) of a photo's sensor or scan, or None where it has neither."""
    if camera.sensor is not None:
        sensor = camera.sensor
        return sensor.width / sensor.columns, sensor.height / sensor.rows
    scan = photo.scan or (template.scan if template else None)
    return scan.pixel if scan else None


def _unknown(what: str, name: str, records: Iterable[Camera | Photo | Template | Temtick]) -> str:
    known = ", ".join(record.name for record in records) or "none"
    return f"{what} {name} is not defined; known are: {known}"


def _in_plate_millimetres(marks: MeasuredMarks, scan: Scan | None) -> MeasuredMarks:
    return replace(marks, measured=scan_transformation(scan).apply(marks.measured)) if scan else marks


def _edited_marks(marks: MeasuredMarks, record: EditRecord) -> tuple[MeasuredMarks, int]:
    chosen = np.array([record.name in ("*", name) for name in marks.names], dtype=bool)
    if record.action == "KILL":
        names = tuple(name for name, kill in zip(marks.names, chosen, strict=True) if not kill)
        left = MeasuredMarks(names, marks.measured[~chosen], marks.disregarded[~chosen], marks.given[~chosen])
        return left, int(chosen.sum())
    disregarded = np.where(chosen, record.action == "DISREGARD", marks.disregarded)
    return replace(marks, disregarded=disregarded), int(chosen.sum())


def _moved_points(points: _PointsOfPhoto, transformation: PlaneTransformation) -> _PointsOfPhoto:
    moved = transformation.apply(np.array([(point.x, point.y) for point in points.values()]).reshape(-1, 2))
    return {
        name: point._replace(x=x, y=y) for (name, point), (x, y) in zip(points.items(), moved.tolist(), strict=True)
    }


def _points_by_photo(observations: PhotoObservations) -> dict[str, _PointsOfPhoto]:
    by_photo: dict[str, _PointsOfPhoto] = {}
    rows = zip(
        observations.photos, observations.points, observations.measured.tolist(), observations.errors.tolist(),
        observations.disregarded.tolist(), strict=True,
    )  # fmt: skip
    for photo, point, (x, y), (x_error, y_error), disregarded in rows:
        by_photo.setdefault(record_key(photo), {})[point] = _PhotoPoint(x, y, x_error, y_error, disregarded)
    return by_photo


def _observations(
    bundle: str, by_photo: Mapping[str, _PointsOfPhoto], photos: Mapping[str, Photo], order: Mapping[str, int]
) -> PhotoObservations:
    keys = sorted((key for key in by_photo if key in order), key=order.__getitem__)
    rows = [(photos[key].name, name, point) for key in keys for name, point in by_photo[key].items()]
    values = np.array([point[:4] for *_, point in rows], dtype=np.float64).reshape(-1, 4)
    return PhotoObservations(
        bundle,
        tuple(photo for photo, *_ in rows),
        tuple(name for _, name, _ in rows),
        values[:, :2],
        values[:, 2:],
        np.array([point.disregarded for *_, point in rows], dtype=bool),
    )
