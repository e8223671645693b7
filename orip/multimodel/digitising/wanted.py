"""Which points and marks are to be digitised, and in which photos."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np
from msgspec import Struct

from orip.errors import Complaint, InputError, UsageError
from orip.files.log.writing import ListedPoint, read_work_list
from orip.files.text.regular_file import natural_key
from orip.geometry.plane import PlaneTransformation
from orip.multimodel.digitising.order import DigitisedBlock, PhotoPair
from orip.multimodel.digitising.session import DriveTarget
from orip.multimodel.state import Position
from orip.records.camera import Mark
from orip.records.definition import BundleDefinition, StereoModel
from orip.records.drive_table import STAGES
from orip.records.measurement import MeasuredMarks
from orip.records.names import name_fault, near_names, record_key
from orip.workflow.observations.films import MountedFilms, plate_of_log, position
from orip.workflow.observations.listed import Places
from orip.workflow.project.bundle_state import BundleState
from orip.workflow.project.texts import raise_complaints


class MarkChoice(NamedTuple):
    """A mark that is meant; one that the record does not have comes with its given coordinates, mm."""

    name: str
    xy: Position | None = None


class WantedMarks(NamedTuple):
    """Which marks are visited: all, those digitised before, or chosen ones."""

    again: bool
    chosen: Sequence[MarkChoice]

    @property
    def keeps(self) -> bool:
        """Return whether marks that are not visited stay."""
        return self.again or bool(self.chosen)


def marks_to_visit(
    title: str, record: Iterable[Mark], before: MeasuredMarks, given: np.ndarray, wanted: WantedMarks
) -> tuple[tuple[Mark, ...], tuple[str, ...]]:
    """Return all marks there may be, and the names of those to visit."""
    of_record = {mark.name: mark for mark in record}
    measured = {name: Mark(name, x, y) for name, (x, y) in zip(before.names, given.tolist(), strict=True)}
    if wanted.chosen:
        known = {**of_record, **measured}
        found = [_chosen_mark(title, known, choice) for choice in wanted.chosen]
        every = {**measured, **{mark.name: mark for mark in found}}
        return tuple(every.values()), tuple(dict.fromkeys(mark.name for mark in found))
    if not wanted.again:
        return tuple(of_record.values()), tuple(of_record)
    if not before.names:
        message = f"{title} has no marks to digitise again; leave --again out"
        raise InputError.single(message)
    return tuple(measured.values()), tuple(measured)


def _chosen_mark(title: str, known: Mapping[str, Mark], choice: MarkChoice) -> Mark:
    mark = known.get(choice.name)
    if mark is None:
        if choice.xy is None:
            near = near_names(choice.name, known)
            message = f"{title} has no mark {choice.name}; {near}; a new one has its coordinates: {choice.name},X,Y"
            raise UsageError(message)
        return Mark(choice.name, *choice.xy)
    if choice.xy not in (None, (mark.x, mark.y)):
        message = f"mark {mark.name} of {title} has the coordinates {mark.x:g}, {mark.y:g}; take another name"
        raise UsageError(message)
    return mark


class PointChoice(Struct, frozen=True):
    """Which points somebody wants to digitise.

    Parameters
    ----------
    photos : tuple of str
        Only in these photos; none: in any.
    model : str or None
        Only in the photos of this model.
    points : tuple of str
        These points; none: all that are (with `again`) measured, or by the last adjustment are to be seen and not
        measured yet.
    file : Path or None
        Points of a list, relative to the project folder.
    again : bool
        Drive to where points were measured, and measure them again.
    only : {"control", "tie"} or None
        Only control and check points, or only points that are neither.
    """

    photos: tuple[str, ...] = ()
    model: str | None = None
    points: tuple[str, ...] = ()
    file: Path | None = None
    again: bool = False
    only: Literal["control", "tie"] | None = None


class BundlePoints(Struct, frozen=True, dict=True):
    """The points of a bundle: where they are measured on the plates, and where they should be; photos by key."""

    films: MountedFilms
    bundle: BundleDefinition
    measured: dict[tuple[str, str], Position]
    places: Places
    photos: Mapping[str, str]
    control: frozenset[str]

    @cached_property
    def measured_photos(self) -> dict[str, list[str]]:
        """Return the photos that each point is measured in."""
        found: dict[str, list[str]] = {}
        for photo, point in self.measured:
            found.setdefault(point, []).append(photo)
        return found

    @cached_property
    def block(self) -> DigitisedBlock:
        """Return the models, and the stages of photos that have one."""
        models = sorted(self.bundle.models, key=lambda model: (model.row, model.column))
        return DigitisedBlock(tuple(map(_pair, models)), self.films.stages)

    def predicted(self, photo: str, point: str) -> Position | None:
        """Return where the last adjustment predicts a point on the plate, also beyond frame lines; None: nowhere."""
        found = self.places.anywhere(photo).get(point)
        if found is None or any(
            coordinate != coordinate for coordinate in found.log_xy
        ):  # NaN: no interior orientation
            return None
        return position(self._plate_of_log(photo), found.log_xy)

    def middle(self, photo: str) -> Position | None:
        """Return where the middle of a photo is on the plate; None where it is not oriented."""
        record = self.films.definitions.photos[photo]
        to_photo, to_plate = self.films.interior.to_photo.get(photo), self.films.plate_of_stored(record)
        if to_photo is None or to_plate is None:
            return None
        return position(to_plate.after(to_photo.inverse()), (0.0, 0.0))

    def place(self, photo: str, point: str, *, again: bool) -> DriveTarget:
        """Return where to look for a point."""
        before, predicted = self.measured.get((photo, point)), self.predicted(photo, point)
        if before is not None and (again or predicted is None):
            return DriveTarget("measured before", before)
        if predicted is not None:
            return DriveTarget("predicted", predicted)
        return DriveTarget("middle", self.middle(photo))

    def measured_at(self, photo: str, plates: tuple[Position, Position]) -> Position:
        """Return what the stage of a photo shows as restitution takes it: pixels of a sensor, else mm in the photo.

        Raises
        ------
        InputError
            If the photo has no interior orientation.
        """
        key, xy = record_key(photo), plates[STAGES.index(self.films.stage_of(photo))]
        record = self.films.definitions.photos[key]
        if self.films.definitions.cameras[record_key(record.camera)].sensor is not None:
            return self.to_log(key, xy)
        to_photo, to_plate = self.films.interior.to_photo.get(key), self.films.plate_of_stored(record)
        if to_photo is None or to_plate is None:
            message = f"photo {record.name} has no interior orientation; digitise its fiducial marks first"
            raise InputError.single(message)
        return position(to_photo.after(to_plate.inverse()), xy)

    def to_log(self, photo: str, xy: Position) -> Position:
        """Return log coordinates of plate coordinates."""
        return position(self._plate_of_log(photo).inverse(), xy)

    def _plate_of_log(self, photo: str) -> PlaneTransformation:
        return plate_of_log(self.films.scan_of(self.films.definitions.photos[photo]))


def bundle_points(films: MountedFilms, name: str | None) -> BundlePoints:
    """Return what is known of the points of a bundle (None: the project's only one).

    Raises
    ------
    UsageError
        If there is no such bundle.
    InputError
        If the ground control or preliminary points are at fault.
    """
    bundle = BundleState(films.state, films.project.bundle_name(name))
    photos = bundle.photos or {key: photo.name for key, photo in films.definitions.photos.items()}
    control = frozenset(point.name for point in bundle.control.points if not point.rejected)
    return BundlePoints(films, bundle.definition, films.points_on_plate(bundle.name), Places(bundle), photos, control)


def wanted_points(points: BundlePoints, choice: PointChoice) -> dict[str, list[str]]:
    """Return the photos in which each point is to be digitised, points in their order; see `PointChoice.only`."""
    found = _wanted_points(points, choice)
    if choice.only is None:
        return found
    return {name: photos for name, photos in found.items() if (name in points.control) == (choice.only == "control")}


def _wanted_points(points: BundlePoints, choice: PointChoice) -> dict[str, list[str]]:
    """Return the photos in which each point is to be digitised, of whatever kind.

    Raises
    ------
    UsageError
        If a photo, model or point is not known, or nothing tells where a point is.
    InputError
        If the list is at fault.
    """
    photos = _photos(points, choice)
    listed = _listed(points, choice)
    named = [ListedPoint(point, None, None, 0) for point in choice.points]
    if not listed and not named:
        if choice.file is not None:
            return {}
        return _all(points, photos, again=choice.again)
    wanted: dict[str, list[str]] = {}
    unknown: list[str] = []
    measured: list[str] = []
    for wanted_point in (*named, *listed):
        if wanted_point.photo is not None:
            found = [photo for photo in photos if photo == record_key(wanted_point.photo)]
        else:
            found = list(_photos_of(points, choice, photos, wanted_point.point))
            if not found:
                is_done = wanted_point.point in points.measured_photos and not choice.again
                (measured if is_done else unknown).append(wanted_point.point)
        of_point = wanted.setdefault(wanted_point.point, [])
        of_point += [photo for photo in found if photo not in of_point]
    _refuse(points, unknown, measured, again=choice.again)
    return {point: of_point for point, of_point in wanted.items() if of_point}


def _photos(points: BundlePoints, choice: PointChoice) -> list[str]:
    """Return the photos that may be meant."""
    photos = list(points.photos)
    if choice.photos:
        photos = [record_key(points.films.photo(name).name) for name in choice.photos]
    if choice.model is not None:
        model = model_named(points.bundle, choice.model)
        photos = [photo for photo in photos if photo in (record_key(model.left), record_key(model.right))]
        if not photos:
            message = f"model {model.name} is made of {model.left} and {model.right}; name these with --photo, or none"
            raise UsageError(message)
    return photos


def model_named(bundle: BundleDefinition, name: str) -> StereoModel:
    """Return a model; raise UsageError, with names like it, if the bundle has none of that name."""
    for model in bundle.models:
        if record_key(model.name) == record_key(name):
            return model
    message = f"bundle {bundle.name} has no model {name}; {near_names(name, (model.name for model in bundle.models))}"
    raise UsageError(message)


def _listed(points: BundlePoints, choice: PointChoice) -> list[ListedPoint]:
    """Return the points of the list, those of other bundles left out."""
    if choice.file is None:
        return []
    path = points.films.project.folder / choice.file
    shown = points.films.project.shown(path)
    found = read_work_list(path, shown)
    faults = [*found.complaints]
    mine = [
        point
        for point in found.value
        if record_key(point.bundle or points.bundle.name) == record_key(points.bundle.name)
    ]
    for point in {record_key(point.photo): point for point in mine if point.photo is not None}.values():
        if record_key(point.photo or "") not in points.films.definitions.photos:
            known = (photo.name for photo in points.films.definitions.photos.values())
            message = f"photo {point.photo} is not defined; {near_names(point.photo or '', known)}"
            faults.append(Complaint(message, shown, point.line))
    raise_complaints(faults)
    return mine


def _all(points: BundlePoints, photos: Sequence[str], *, again: bool) -> dict[str, list[str]]:
    if again:
        pairs = [pair for pair in points.measured if pair[0] in photos]
    else:
        pairs = [
            (photo, point)
            for photo in photos
            for point in points.places.predicted(photo)
            if (photo, point) not in points.measured and points.predicted(photo, point) is not None
        ]
    names = sorted({point for _, point in pairs}, key=lambda point: (natural_key(point), point))
    of_point: dict[str, list[str]] = {point: [] for point in names}
    for photo, point in pairs:
        of_point[point].append(photo)
    return of_point


def _photos_of(points: BundlePoints, choice: PointChoice, photos: Iterable[str], point: str) -> Iterator[str]:
    """Yield the photos in which a point that was named is to be digitised.

    Photos that were named, or a model, are taken as they are; else it is those that should show the point.
    """
    is_named = bool(choice.photos) or choice.model is not None
    for photo in photos:
        if choice.again:
            if (photo, point) in points.measured:
                yield photo
        elif (photo, point) not in points.measured and (is_named or point in points.places.predicted(photo)):
            yield photo


def _refuse(points: BundlePoints, unknown: Sequence[str], measured: Sequence[str], *, again: bool) -> None:
    """Raise InputError for points that nothing can be done about, all of them."""
    complaints = [
        Complaint(f"point {point} is already measured in all photos that were chosen; measure it again with --again")
        for point in measured
    ]
    for point in unknown:
        fault = name_fault(point)
        if fault is not None:
            complaints.append(Complaint(f"point {point}: {fault}"))
        elif again:
            near = near_names(point, points.measured_photos)
            complaints.append(Complaint(f"point {point} is not measured in any of the photos that were chosen; {near}"))
        else:
            text = f"the position of point {point} is not known; name the photos with --photo, or a model with --model"
            complaints.append(Complaint(text))
    if complaints:
        raise InputError(complaints)


def _pair(model: StereoModel) -> PhotoPair:
    name, left, right = (record_key(owner) for owner in (model.name, model.left, model.right))
    return PhotoPair(name, left, right, model.row, model.column)
