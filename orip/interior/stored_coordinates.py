"""The end of a replay: what was measured in any mounting, taken to the coordinates that are stored.

Stored are template coordinates of photos on a template, plate coordinates of the last mounting of photos off a
template, and pixels of digital frames.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from orip.errors import OrientationError
from orip.geometry.plane import IDENTITY, PlaneTransformation
from orip.interior.definitions import Definitions
from orip.interior.image_coordinates import pixel_size
from orip.interior.measured_points import Findings, MeasuredPoints
from orip.interior.mounting import STORED, FilmMountings, Mounting, Orientation, chosen_marks, joined_marks
from orip.interior.orientation import orient_photo, orient_template
from orip.records.measurement import MeasuredMarks, PhotoOrientation, TemplateOrientation
from orip.records.names import record_key
from orip.records.photo import Photo
from orip.structs import replace


class StoredCoordinates:
    """Transformations of all mountings, each found once; a mounting that is not oriented is complained of once."""

    def __init__(
        self,
        definitions: Definitions,
        templates: FilmMountings[TemplateOrientation],
        photos: FilmMountings[PhotoOrientation],
        points: MeasuredPoints,
        findings: Findings,
    ) -> None:
        self._definitions = definitions
        self._templates = templates
        self._photos = photos
        self._points = points
        self._findings = findings
        self._found: dict[tuple[str, str, int], PlaneTransformation | None] = {}

    def template_orientations(self) -> dict[str, TemplateOrientation]:
        """Return the orientations in force of all defined templates."""
        result = {}
        for key, template in self._definitions.templates.items():
            mountings = self._templates.of(key)
            is_in_force = self._is_in_force(f"template {template.name}", mountings)
            if is_in_force and self._plate_to_template(key, len(mountings) - 1) is not None:
                result[key] = mountings[-1].orientation
        return result

    def photo_orientations(self) -> dict[str, PhotoOrientation]:
        """Return the orientations in force of all defined photos, marks in stored coordinates."""
        result = {}
        for key, photo in self._definitions.photos.items():
            mountings = self._photos.of(key)
            if not self._is_in_force(f"photo {photo.name}", mountings):
                continue
            marks = self._stored_marks(key, photo) if self._measured_to_photo(key, len(mountings) - 1) else None
            if marks is not None:
                result[key] = replace(mountings[-1].orientation, marks=marks)
        return result

    def _is_in_force(self, film: str, mountings: Sequence[Mounting[Orientation]]) -> bool:
        """Whether a film is oriented by marks; warn where it was until all of them were killed."""
        place = mountings[-1].ended_by if mountings else None
        if place is not None:
            text = (
                f"{film} is no longer oriented: all its marks are killed; measure them again, with 'orip digitise ... "
                "--log EDITS.MEA' or a file for 'orip observations remeasure'"
            )
            self._findings.warn(place, "no-longer-oriented", text)
        return bool(mountings) and place is None

    def of_points(self, photo_key: str, mounting: int) -> PlaneTransformation | None:
        """Return measured to stored coordinates of points of a photo measured in a mounting; None after a complaint."""
        photo = self._definitions.photos[photo_key]
        if photo.template is not None:
            return self._plate_to_template(record_key(photo.template), mounting)
        in_force = len(self._photos.of(photo_key)) - 1
        first = max(mounting, 0)
        if first >= in_force:
            return IDENTITY
        to_photo, to_plate = self._measured_to_photo(photo_key, first), self._measured_to_photo(photo_key, in_force)
        return to_plate.inverse().after(to_photo) if to_photo and to_plate else None

    def pixel_size(self, photo_key: str, mounting: int) -> tuple[float, float]:
        """Return the size (mm) along the photo axes of the pixels in which points were measured in a mounting.

        1 where there are none: that has been complained of.
        """
        photo = self._definitions.photos[photo_key]
        camera, template = self._definitions.camera_of(photo), self._definitions.template_of(photo)
        return pixel_size(photo, camera, template, self._plate_to_photo(photo_key, photo, mounting)) or (1.0, 1.0)

    def _plate_to_photo(self, key: str, photo: Photo, mounting: int) -> PlaneTransformation | None:
        """Return plate to photo coordinates in a mounting of the film; None where the photo is not oriented."""
        last = len(self._photos.of(key)) - 1
        if last < 0 or (photo.template is None and mounting > last):
            return None
        if photo.template is None:
            return self._measured_to_photo(key, max(mounting, 0))
        template = record_key(photo.template)
        marks_to_photo = self._measured_to_photo(key, last)
        marks_to_template = self._plate_to_template(template, self._photos.of(key)[last].template_mounting)
        points_to_template = self._plate_to_template(template, mounting)
        if marks_to_photo is None or marks_to_template is None or points_to_template is None:
            return None
        return marks_to_photo.after(marks_to_template.inverse()).after(points_to_template)

    def _stored_marks(self, key: str, photo: Photo) -> MeasuredMarks | None:
        mountings = self._photos.of(key)
        marks = mountings[-1].orientation.marks
        if photo.template is None:
            return self._with_earlier_marks(key, mountings)
        to_stored = self._plate_to_template(record_key(photo.template), mountings[-1].template_mounting)
        return replace(marks, measured=to_stored.apply(marks.measured)) if to_stored else None

    def _with_earlier_marks(self, key: str, mountings: Sequence[Mounting[PhotoOrientation]]) -> MeasuredMarks:
        """Return the marks of a photo off a template with those of earlier mountings that were not measured again.

        Their residuals are listed, but they have no say: the new marks alone tell where the photo lies now.
        """
        marks = mountings[-1].orientation.marks
        for number in reversed(range(len(mountings) - 1)):
            if mountings[number].ended_by is not None:
                break  # these marks and those of before were killed
            earlier = mountings[number].orientation.marks
            rows = [row for row, name in enumerate(earlier.names) if name not in marks.names]
            if not rows or not self._is_oriented(key, number):
                continue
            carried = chosen_marks(earlier, rows)
            moved = self.of_points(key, number)
            if moved is not None:
                carried = replace(
                    carried, measured=moved.apply(carried.measured), disregarded=np.ones(len(rows), dtype=bool)
                )
                marks = joined_marks(marks, carried)
        return marks

    def _is_oriented(self, key: str, number: int) -> bool:
        """Whether a mounting is oriented, without a complaint: one in which no point was measured need not be."""
        if number in {max(mounting, 0) for mounting in self._points.mountings(key)}:
            return self._measured_to_photo(key, number) is not None
        return _is_valid(lambda orientation: self._orient_photo(key, orientation), self._photos.of(key)[number])

    def _plate_to_template(self, key: str, number: int) -> PlaneTransformation | None:
        if number == STORED:
            return IDENTITY

        def orient(orientation: TemplateOrientation) -> PlaneTransformation:
            temtick = self._definitions.temtick_of(self._definitions.templates[key])
            return orient_template(orientation, temtick.ticks).transformation

        return self._once(("template", key, number), self._templates.of(key)[number], orient)

    def _measured_to_photo(self, key: str, number: int) -> PlaneTransformation | None:
        mounting = self._photos.of(key)[number]
        return self._once(("photo", key, number), mounting, lambda orientation: self._orient_photo(key, orientation))

    def _orient_photo(self, key: str, orientation: PhotoOrientation) -> PlaneTransformation:
        photo = self._definitions.photos[key]
        camera = self._definitions.camera_of(photo)
        return orient_photo(orientation, camera, photo.template is not None).transformation

    def _once(
        self,
        which: tuple[str, str, int],
        mounting: Mounting[Orientation],
        orient: Callable[[Orientation], PlaneTransformation],
    ) -> PlaneTransformation | None:
        if which not in self._found:
            try:
                self._found[which] = orient(mounting.orientation)
            except OrientationError as error:
                self._found[which] = None
                self._blame(mounting, orient, str(error))
        return self._found[which]

    def _blame(
        self, mounting: Mounting[Orientation], orient: Callable[[Orientation], PlaneTransformation], message: str
    ) -> None:
        """Complain where a mounting became invalid: at its own record, or at the edit that spoilt it."""
        place = mounting.history[-1][1]
        for length in reversed(range(1, len(mounting.history))):
            if _is_valid(orient, replace(mounting, history=mounting.history[:length])):
                break
            place = mounting.history[length - 1][1]
        self._findings.complain(place, message)


def _is_valid(orient: Callable[[Orientation], PlaneTransformation], mounting: Mounting[Orientation]) -> bool:
    try:
        orient(mounting.orientation)
    except OrientationError:
        return False
    return True
