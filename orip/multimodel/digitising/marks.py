"""`orip digitise template` and `orip digitise photo`: tick marks and fiducial marks, driven to and digitised."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from math import isnan
from typing import Literal

import numpy as np
from msgspec import Struct

from orip.errors import InputError, OrientationError, ProjectWarning, UsageError
from orip.files.log.writing import measurement_line, photo_header, template_header
from orip.geometry.plane import PlaneTransformation
from orip.interior.in_force import DrivingOrientation, drive_photo, drive_template
from orip.interior.orientation import (
    OrientedMarks,
    given_coordinates_of_photo,
    given_coordinates_of_template,
    orient_photo,
    orient_template,
)
from orip.multimodel.digitising.operator import Sought, Visit
from orip.multimodel.digitising.session import DriveTarget, Entry, Outcome, Session
from orip.multimodel.digitising.setup import Digitised, DigitisingSetup
from orip.multimodel.digitising.wanted import MarkChoice, WantedMarks, marks_to_visit
from orip.multimodel.link.client import ProcessorFault
from orip.multimodel.project_link import load_again
from orip.multimodel.state import Position
from orip.records.camera import Mark
from orip.records.interior import MarkAdjustment
from orip.records.measurement import (
    MeasuredMarks,
    PhotoOrientation,
    TemplateOrientation,
    TransformationKind,
)
from orip.records.names import record_key
from orip.records.photo import Photo, Stage, Template
from orip.workflow.observations.films import MountedFilms, plate_of_log, position


class _Sheet(Struct, frozen=True):
    """A template or photo whose marks are digitised.

    `marks` are all there may be, with their given coordinates, `visited` the names of those to visit, `of_record` of
    those that need not say their coordinates; `before` is what was measured before, on the plate.
    `driving` and `adjusted` take digitised marks, plate to given; `to_marks` takes the plate to the system that the
    marks of the orientation are in.
    """

    what: Literal["TICK", "MARK"]
    name: str
    stage: Stage
    header: str
    marks: tuple[Mark, ...]
    visited: tuple[str, ...]
    of_record: frozenset[str]
    before: MeasuredMarks
    again: bool
    to_log: PlaneTransformation
    to_marks: PlaneTransformation
    driving: Callable[[MeasuredMarks], DrivingOrientation]
    adjusted: Callable[[MeasuredMarks], OrientedMarks]

    @property
    def title(self) -> str:
        """Return what the sheet is called."""
        return f"{'template' if self.what == 'TICK' else 'photo'} {self.name}"


def digitise_template(
    setup: DigitisingSetup,
    template: str,
    *,
    kind: TransformationKind | None = None,
    stage: Stage | None = None,
    again: bool = False,
    chosen: Sequence[MarkChoice] = (),
) -> Digitised:
    """Digitise the tick marks of a template that has been mounted.

    Parameters
    ----------
    kind : {"A", "C", "W"} or None
        None: as it was oriented before, else affine.
    stage : {"UPPER", "LOWER"} or None
        None: as it was mounted before, or as defined.
    again : bool
        Drive to where they were digitised, and keep what is not digitised again.
    chosen : sequence of MarkChoice
        These alone, and the others stay as they were digitised before.

    Raises
    ------
    UsageError, InputError, LinkError
    """
    films = setup.films()
    sheet = _template_sheet(films, films.template(template), kind, stage, WantedMarks(again, chosen))
    return _digitise(films, setup, [sheet])


def digitise_photos(
    setup: DigitisingSetup,
    photos: Sequence[str],
    *,
    template: str | None = None,
    kind: TransformationKind | None = None,
    again: bool = False,
    start: str | None = None,
    chosen: Sequence[MarkChoice] = (),
) -> Digitised:
    """Digitise the fiducial marks of photos, one after the other.

    Parameters
    ----------
    template : str or None
        All photos on that template instead.
    start : str or None
        The photo to begin with.
    chosen : sequence of MarkChoice
        These marks alone, and the others stay as they were digitised before.

    Raises
    ------
    UsageError, InputError, LinkError
    """
    films = setup.films()
    if bool(photos) == (template is not None):
        message = "name photos, or a template with --template to digitise all photos on it"
        raise UsageError(message)
    meant = [films.photo(name) for name in photos] if template is None else _on_template(films, template)
    if start is not None:
        names = [record_key(photo.name) for photo in meant]
        if record_key(start) not in names:
            message = f"photo {start} is not among those to digitise: {', '.join(photo.name for photo in meant)}"
            raise UsageError(message)
        meant = meant[names.index(record_key(start)) :]
    return _digitise(films, setup, [_photo_sheet(films, photo, kind, WantedMarks(again, chosen)) for photo in meant])


def _on_template(films: MountedFilms, template: str) -> list[Photo]:
    key = record_key(films.template(template).name)
    found = [photo for photo in films.definitions.photos.values() if record_key(photo.template or "") == key]
    if not found:
        message = f'no photo is on template {template}; define photos with template = "{template}" in orip.toml'
        raise InputError.single(message)
    return found


def _template_sheet(
    films: MountedFilms, template: Template, kind: TransformationKind | None, stage: Stage | None, wanted: WantedMarks
) -> _Sheet:
    known = films.measured.templates.get(record_key(template.name))
    before = films.ticks_on_plate(template)
    ticks = films.definitions.temtick_of(template).ticks
    fitted: TransformationKind = kind or (known.transformation if known else "A")
    mounted = stage or _stage_of_template(films, template)
    stored = films.interior.to_template.get(record_key(template.name))

    def orientation(marks: MeasuredMarks) -> TemplateOrientation:
        return TemplateOrientation(template.name, fitted, mounted, marks)

    given = given_coordinates_of_template(orientation(before), ticks)
    return _Sheet(
        "TICK", template.name, mounted, template_header(template.name, fitted, mounted),
        *marks_to_visit(f"template {template.name}", ticks, before, given, wanted), _names(ticks), before, wanted.keeps,
        plate_of_log(template.scan).inverse(), plate_of_log(None),
        lambda marks: drive_template(orientation(marks), ticks, stored),
        lambda marks: orient_template(orientation(marks), ticks),
    )  # fmt: skip


def _stage_of_template(films: MountedFilms, template: Template) -> Stage:
    known = films.measured.templates.get(record_key(template.name))
    on_it = (films.stages.get(record_key(photo.name)) for photo in films.definitions.photos.values()
             if record_key(photo.template or "") == record_key(template.name))  # fmt: skip
    stage = (known.stage if known else None) or template.stage or next(on_it, None)
    if stage is None:
        message = f"the stage of template {template.name} is not known; name it with --stage UPPER or LOWER"
        raise UsageError(message)
    return stage


def _photo_sheet(films: MountedFilms, photo: Photo, kind: TransformationKind | None, wanted: WantedMarks) -> _Sheet:
    camera = films.definitions.camera_of(photo)
    if not camera.fiducials:
        message = f"photo {photo.name} has no fiducial marks: its camera {camera.name} has none"
        raise InputError.single(message)
    to_plate = films.plate_of_stored(photo)
    if to_plate is None:
        message = (
            f"photo {photo.name} is on template {photo.template}, which is not oriented; digitise its tick marks "
            f"first: orip digitise template {photo.template}"
        )
        raise InputError.single(message)
    known = films.measured.photos.get(record_key(photo.name))
    before = films.fiducials_on_plate(photo)
    fitted: TransformationKind = kind or (known.transformation if known else "A")
    stored = films.interior.to_photo.get(record_key(photo.name))

    def orientation(marks: MeasuredMarks) -> PhotoOrientation:
        return PhotoOrientation(photo.name, fitted, marks)

    given = given_coordinates_of_photo(orientation(before), camera)
    return _Sheet(
        "MARK", photo.name, films.stage_of(photo.name), photo_header(photo.name, fitted),
        *marks_to_visit(f"photo {photo.name}", camera.fiducials, before, given, wanted),
        _names(camera.fiducials), before, wanted.keeps,
        plate_of_log(films.scan_of(photo)).inverse(), to_plate.inverse(),
        lambda marks: drive_photo(orientation(marks), camera, stored),
        lambda marks: orient_photo(orientation(marks), camera, photo.template is not None),
    )  # fmt: skip


def _names(marks: Iterable[Mark]) -> frozenset[str]:
    return frozenset(mark.name for mark in marks)


def _digitise(films: MountedFilms, setup: DigitisingSetup, sheets: Sequence[_Sheet]) -> Digitised:
    going_on = f"all of it is in {films.shown_log}; repeat the command, photos of a template with --from PHOTO"
    orientations: list[MarkAdjustment] = []
    with setup.session(films, going_on) as session:
        for number, sheet in enumerate(sheets, start=1):
            session.tell(f"{sheet.title} on the {sheet.stage} stage ({number} of {len(sheets)})")
            orientations += _digitise_sheet(session, sheet)
            if session.ending != "complete":
                break
        if orientations and not setup.is_trial:
            _load_table_again(films, session)
    return setup.outcome(films, session, orientations)


def _load_table_again(films: MountedFilms, session: Session) -> None:
    """Load the drive table with the new orientation where the plate processor drives with the one before."""
    try:
        bundle = load_again(films.project.folder, films.log, session.link)
    except (InputError, ProcessorFault) as reason:
        text = f"still has the orientation from before: {reason}; run 'orip drive download' when that is mended"
        session.warnings.append(ProjectWarning("stale-table", "the plate processor", text))
    else:
        if bundle is not None:
            session.tell(f"download  {bundle}.DRV with this orientation is loaded into the plate processor")


class _Digitising:
    """The marks of a sheet as they come in: where they are on the plate, and their lines in the log."""

    def __init__(self, sheet: _Sheet) -> None:
        self._sheet = sheet
        self._before: dict[str, Position] = {
            name: (x, y) for name, (x, y) in zip(sheet.before.names, sheet.before.measured.tolist(), strict=True)
        }
        self._on_plate = dict(self._before) if sheet.again else {}
        self._new: set[str] = set()
        self._has_changed = False

    def place(self, mark: Mark) -> DriveTarget:
        """Return where to look for a mark: where it was, or by the marks that were digitised already."""
        if self._sheet.again and mark.name in self._before:
            return DriveTarget("measured before", self._before[mark.name])
        to_given = self._sheet.driving(self.marks()).transformation.after(self._sheet.to_marks)
        return DriveTarget("predicted", position(to_given.inverse(), (mark.x, mark.y)))

    def take(self, mark: Mark, outcome: Outcome, xy: Position | None) -> None:
        """Take what was decided about a mark."""
        if xy is not None:
            self._on_plate[mark.name] = xy
            self._new.add(mark.name)
        elif outcome == "skipped":
            self._on_plate.pop(mark.name, None)
        elif mark.name in self._before:
            self._on_plate[mark.name] = self._before[mark.name]
        self._has_changed |= xy is not None or (outcome == "skipped" and self._sheet.again)

    def lines(self) -> list[str]:
        """Return the lines of the log's block; none as long as nothing has changed."""
        if not self._has_changed:
            return []
        marks = self.marks()
        own = {mark.name for mark in self._sheet.marks} - self._sheet.of_record
        return [
            measurement_line(
                name,
                position(self._sheet.to_log, self._on_plate[name]),
                (x, y) if name in own else None,
                is_disregarded=bool(off),
            )
            for name, (x, y), off in zip(marks.names, marks.given.tolist(), marks.disregarded, strict=True)
        ]

    def marks(self) -> MeasuredMarks:
        """Return the marks there are, in the system of the orientation's marks."""
        names = tuple(mark.name for mark in self._sheet.marks if mark.name in self._on_plate)
        given = {mark.name: (mark.x, mark.y) for mark in self._sheet.marks}
        before = dict(zip(self._sheet.before.names, self._sheet.before.disregarded.tolist(), strict=True))
        return MeasuredMarks(
            names,
            self._sheet.to_marks.apply(np.array([self._on_plate[name] for name in names]).reshape(-1, 2)),
            np.array([name not in self._new and before.get(name, False) for name in names], dtype=bool),
            np.array([given[name] for name in names]).reshape(-1, 2),
        )


def _digitise_sheet(session: Session, sheet: _Sheet) -> Iterator[MarkAdjustment]:
    """Digitise the marks of a sheet; yield its orientation if they suffice for one."""
    digitising = _Digitising(sheet)
    what = sheet.what.lower()
    session.log.chapter(f"orip digitise {sheet.title}")
    session.link.guide(sheet.stage)
    marks = {mark.name: mark for mark in sheet.marks}
    for mark in [marks[name] for name in sheet.visited]:
        place = session.drive(sheet.stage, digitising.place(mark))
        session.tell(f"at {what} {mark.name} of {sheet.name} ({place.known})")
        sought = Sought(sheet.what, record_key(sheet.name), mark.name, sheet.stage)
        decision = session.decision(Visit((sought,), "FOOT LEFT"))
        if decision.outcome is None:
            break
        xy = decision.at(sheet.stage)
        digitising.take(mark, decision.outcome, xy)
        session.log.put(sheet.header, digitising.lines())
        logged = None if xy is None else position(sheet.to_log, xy)
        session.enter(Entry(what, sheet.name, mark.name, decision.outcome, place.known, place.xy, logged))
        if digitising.lines():
            _tell_orientation(session, sheet, digitising.marks())
    if not digitising.lines():
        return
    try:
        yield sheet.adjusted(digitising.marks()).adjustment
    except OrientationError as reason:
        session.warnings.append(ProjectWarning("not-oriented", sheet.title, str(reason)))


def _tell_orientation(session: Session, sheet: _Sheet, marks: MeasuredMarks) -> None:
    """Report the orientation as it is after this mark: its parameters, and the residuals of all marks."""
    try:
        found = sheet.adjusted(marks).adjustment
    except OrientationError as reason:
        session.tell(f"  not oriented yet: {reason}")
        return
    for line in orientation_lines(found):
        session.tell(f"  {line}")


def orientation_lines(found: MarkAdjustment) -> Iterator[str]:
    """Yield the parameters of an orientation, and the residuals of its marks (mm; in brackets: disregarded)."""
    summary = found.summary
    s0 = "no redundancy" if isnan(summary.s0) else f"s0 {summary.s0:.4f}, redundancy {summary.redundancy}"
    yield (
        f"x0 {summary.x0:z.4f}  y0 {summary.y0:z.4f}  ro {summary.ro:z.5f}  sk {summary.sk:z.5f}  sx {summary.sx:.6f}  "
        f"sy {summary.sy:.6f}  {s0}"
    )
    rows = zip(found.marks.names, found.residuals.tolist(), found.marks.disregarded.tolist(), strict=True)
    texts = [(f"{name} {vx:z.4f} {vy:z.4f}", off) for name, (vx, vy), off in rows]
    yield "VX VY  " + "  ".join(f"({text})" if off else text for text, off in texts)
