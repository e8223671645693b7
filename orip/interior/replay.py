"""Replaying a measurement log: what the records, one after the other, leave measured.

Photo and point measurements are kept in template coordinates (plate coordinates off a template, pixels of a digital
frame), so that a template mounted again needs only its ticks to be oriented again. A photo off a template that is
mounted again takes its earlier points and marks along: old plate to photo to new plate. An edit concerns the mounting
in which the mark was last measured, and everything measured in it.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from msgspec import Struct

from orip.errors import Complaint, OrientationError, ProjectWarning
from orip.geometry.plane import IDENTITY, PlaneTransformation
from orip.interior.definitions import Definitions, unknown_record
from orip.interior.image_coordinates import pixel_size, scan_transformation
from orip.interior.measured_points import Findings, MeasuredPoints, PointsOfPhoto, points_of_record
from orip.interior.mounting import (
    STORED,
    FilmMountings,
    Mounting,
    camera_with_digitised_fiducials,
    temtick_with_digitised_ticks,
)
from orip.interior.stored_coordinates import StoredCoordinates
from orip.records.camera import Camera
from orip.records.measurement import (
    EditRecord,
    FiducialsRecord,
    LogRecord,
    Measured,
    PhotoOrientation,
    PhotoRecord,
    PointsRecord,
    TemplateOrientation,
    TemplateRecord,
    TextPlace,
    TicksRecord,
)
from orip.records.names import record_key
from orip.records.photo import Photo, Template, Temtick
from orip.structs import replace

__all__ = ["Definitions", "Measured", "Replayed", "pixel_size", "replay"]


_SAME_POINT = 10.0
"""A-priori errors by which measurements of one point may differ: seven times the standard deviation of a difference."""

_WHAT_COUNTS = {
    "replace": "it replaces the earlier measurement",
    "mean": "the mean of both counts",
    "both": "both count as observations",
}


class Replayed(Struct, frozen=True):
    """The outcome of a replay: what is measured, what was wrong, what to know, and how many points came again."""

    measured: Measured
    complaints: tuple[Complaint, ...]
    warnings: tuple[ProjectWarning, ...]
    remeasured: int


def replay(records: Iterable[LogRecord], definitions: Definitions, start: Measured) -> Replayed:
    """Replay log records on top of what is already measured.

    Parameters
    ----------
    records : iterable of LogRecord
        In the order of the log.
    start : Measured
        What the stores hold; empty to replay from the beginning.

    Returns
    -------
    Replayed
        With complaints, `measured` is not to be kept.
    """
    log = _Replay(definitions, start)
    for record in records:
        log.take(record)
    measured = log.measured()
    return Replayed(measured, log.findings.complaints(), log.findings.warnings(), log.points.remeasured)


def replay_complaints(records: Iterable[LogRecord], definitions: Definitions) -> tuple[Complaint, ...]:
    """Return what a replay of log records from the beginning complains of, without the coordinates of its points."""
    log = _Replay(definitions, Measured())
    for record in records:
        log.take(record)
    log.require_orientations()
    return log.findings.complaints()


class _Replay:
    """A replay in progress."""

    def __init__(self, definitions: Definitions, start: Measured) -> None:
        self.definitions = replace(
            definitions,
            cameras={**definitions.cameras, **start.cameras},
            temticks={**definitions.temticks, **start.temticks},
        )
        self.templates = FilmMountings(start.templates)
        self.photos = FilmMountings(start.photos)
        self.points = MeasuredPoints(
            start.observations, definitions.averaged_bundles, definitions.bundles_with_repetitions,
            definitions.sources_of_points,
        )  # fmt: skip
        self.digitised_cameras: dict[str, Camera] = dict(start.cameras)
        self.digitised_temticks: dict[str, Temtick] = dict(start.temticks)
        self.findings = Findings()

    def take(self, record: LogRecord) -> None:
        """Take one record; one that is at fault leaves a complaint and nothing else."""
        self.findings.reads(record.place)
        try:
            self._take(record)
        except OrientationError as error:
            self.findings.complain(record.place, str(error))

    def _take(self, record: LogRecord) -> None:
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
                camera = camera_with_digitised_fiducials(record, self.definitions)
                self.definitions = self.definitions.with_camera(camera)
                self.digitised_cameras[record_key(camera.name)] = camera
            case TicksRecord():
                temtick = temtick_with_digitised_ticks(record, self.definitions)
                self.definitions = self.definitions.with_temtick(temtick)
                self.digitised_temticks[record_key(temtick.name)] = temtick

    def measured(self) -> Measured:
        """Return what is measured, photos in the order of their definition."""
        stored = self._stored_coordinates()
        return Measured(
            stored.template_orientations(),
            stored.photo_orientations(),
            self.points.observations(
                self.definitions.bundles, self.definitions.photos, stored.of_points, stored.pixel_size
            ),
            self.digitised_cameras,
            self.digitised_temticks,
        )

    def require_orientations(self) -> None:
        """Complain of what `measured` complains of."""
        stored = self._stored_coordinates()
        stored.template_orientations()
        stored.photo_orientations()
        self.points.require_orientations(
            self.definitions.bundles, self.definitions.photos, stored.of_points, stored.pixel_size
        )

    def _stored_coordinates(self) -> StoredCoordinates:
        return StoredCoordinates(self.definitions, self.templates, self.photos, self.points, self.findings)

    # marks

    def _mount_template(self, record: TemplateRecord) -> None:
        template = self._template(record.template)
        to_plate = scan_transformation(template.scan) if template.scan else IDENTITY
        marks = replace(record.marks, measured=to_plate.apply(record.marks.measured))
        orientation = TemplateOrientation(template.name, record.transformation, record.stage or template.stage, marks)
        self.templates.mount(record_key(template.name), Mounting(((orientation, record.place),)))

    def _measure_photo(self, record: PhotoRecord) -> None:
        photo = self._photo(record.photo)
        camera = self.definitions.camera_of(photo)
        if camera.sensor is not None:
            message = (
                f"photo {photo.name} is a digital frame (camera {camera.name} has a sensor) and has no fiducial marks; "
                "take this PHOTO record out, or give the camera fiducials instead of the sensor"
            )
            raise OrientationError(message)
        marks = replace(record.marks, measured=self._to_plate(photo).apply(record.marks.measured))
        orientation = PhotoOrientation(photo.name, record.transformation, marks)
        mounting = Mounting(((orientation, record.place),), self._template_mounting(photo))
        if photo.template is None:
            self.photos.mount(record_key(photo.name), mounting)
        else:
            self.photos.mount_only(record_key(photo.name), mounting)

    def _to_plate(self, photo: Photo) -> PlaneTransformation:
        """Return the transformation of a photo's log coordinates to plate millimetres."""
        template = self.definitions.template_of(photo)
        scan = photo.scan or (template.scan if template else None)
        return scan_transformation(scan) if scan else IDENTITY

    def _template_mounting(self, photo: Photo) -> int:
        """Return the mounting in force of the template that a photo is on."""
        template = self.definitions.template_of(photo)
        if template is None:
            return STORED
        if self.templates.in_force(record_key(template.name)) is None:
            message = (
                f"photo {photo.name} is on template {template.name}, which is not oriented yet; "
                f"measure its tick marks first (TEMPLATE {template.name} A ...)"
            )
            raise OrientationError(message)
        return len(self.templates.of(record_key(template.name))) - 1

    # points

    def _measure_points(self, record: PointsRecord) -> None:
        bundle, photo = self._bundle_and_photo(record.bundle, record.photo, record.place)
        camera = self.definitions.camera_of(photo)
        self._require_pixels(record, photo, camera)
        if camera.sensor is not None:
            measured, mounting = record.measured, STORED
        else:
            measured, mounting = self._to_plate(photo).apply(record.measured), self._mounting_in_force(photo)
        points = points_of_record(record, measured, mounting)
        self._warn_of_differences(record, bundle, photo, points)
        self.points.measure(record_key(bundle), record_key(photo.name), points)

    def _warn_of_differences(self, record: PointsRecord, bundle: str, photo: Photo, points: PointsOfPhoto) -> None:
        """Warn of points that were measured before at a place that measuring errors do not explain."""
        setting = self.definitions.settings.get(record_key(bundle))
        if setting is None:
            return
        size = pixel_size(photo, self.definitions.camera_of(photo), self.definitions.template_of(photo), None)
        in_pixels = self.definitions.camera_of(photo).sensor is not None
        precision = np.full(2, setting.measurement_precision.value)
        if (setting.measurement_precision.unit == "px") != in_pixels:
            # off a scan without orientation the size of its pixels is that of an upright photo
            precision = precision * (size or (1.0, 1.0)) if not in_pixels else precision / (size or (1.0, 1.0))
        does = _WHAT_COUNTS[setting.repeated_points]
        for name, difference in self.points.differences(record_key(bundle), record_key(photo.name), points):
            if (np.abs(difference) > _SAME_POINT * precision).any():
                unit = "px" if in_pixels else "mm"
                text = (
                    f"point {name} of photo {photo.name} was measured before, {np.linalg.norm(difference):.3g} {unit} "
                    f"from here; {does}; check that it is the same point"
                )
                line = int(record.lines[record.names.index(name)])
                self.findings.warn(TextPlace(record.place.path, line), "measured-again-elsewhere", text)

    def _mounting_in_force(self, photo: Photo) -> int:
        if photo.template is not None:
            return self._template_mounting(photo)
        # points measured before the first PHOTO record, or after its marks were killed, belong to the next mounting
        key = record_key(photo.name)
        count = len(self.photos.of(key))
        return count if self.photos.in_force(key) is None else count - 1

    def _require_pixels(self, record: PointsRecord, photo: Photo, camera: Camera) -> None:
        """Complain of errors in pixels where there are none; how large they are is known when the log has ended."""
        in_pixels = record.errors_in_pixels.any(axis=1)
        if in_pixels.any() and pixel_size(photo, camera, self.definitions.template_of(photo), None) is None:
            line = int(record.lines[in_pixels][0])
            message = f"an a-priori error in px needs a sensor or scan, and photo {photo.name} has neither; write mm"
            self.findings.complain(TextPlace(record.place.path, line), message)

    # edits

    def _edit(self, record: EditRecord) -> None:
        match record.what:
            case "POINT":
                found = self._edit_points(record)
            case "MARK":
                if record.owner != "*":
                    self._photo(record.owner)
                found = bool(self.photos.edit(record))
            case "TICK":
                found = self._edit_ticks(record)
        if not found:
            owner = f"{record.bundle} {record.owner}" if record.bundle else record.owner
            text = f"{record.action} {record.what} {owner} {record.name} finds nothing measured: nothing is changed"
            self.findings.warn(record.place, "nothing-to-edit", text)

    def _edit_points(self, record: EditRecord) -> bool:
        name = record.bundle or ""
        if record.owner != "*":
            self._bundle_and_photo(name, record.owner, record.place)
        try:
            return self.points.edit(record_key(self._bundle(name)), record) > 0
        except ValueError as fault:
            raise OrientationError(str(fault)) from None

    def _edit_ticks(self, record: EditRecord) -> bool:
        if record.owner != "*":
            self._template(record.owner)
        edited = self.templates.edit(record)
        for key in edited:
            mounting = self.templates.of(key)[-1]
            if mounting.history[0][1] is None:
                text = (
                    f"template {mounting.orientation.template} was mounted in an earlier run, and what was measured "
                    "in it then is not moved; 'orip measure' without files replays everything with this edit"
                )
                self.findings.warn(record.place, "stored-points-stay", text)
        return bool(edited)

    # names

    def _template(self, name: str) -> Template:
        template = self.definitions.templates.get(record_key(name))
        if template is None:
            known = (template.name for template in self.definitions.templates.values())
            raise OrientationError(unknown_record("template", name, known))
        return template

    def _photo(self, name: str) -> Photo:
        photo = self.definitions.photos.get(record_key(name))
        if photo is None:
            raise OrientationError(self._unknown_photo(name))
        return photo

    def _unknown_photo(self, name: str) -> str:
        return unknown_record("photo", name, (photo.name for photo in self.definitions.photos.values()))

    def _bundle(self, name: str) -> str:
        bundle = self.definitions.bundles.get(record_key(name))
        if bundle is None:
            raise OrientationError(unknown_record("bundle", name, self.definitions.bundles.values()))
        return bundle

    def _bundle_and_photo(self, bundle: str, photo: str, place: TextPlace) -> tuple[str, Photo]:
        if record_key(bundle) not in self.definitions.bundles and record_key(photo) not in self.definitions.photos:
            self.findings.complain(place, self._unknown_photo(photo))
        return self._bundle(bundle), self._photo(photo)
