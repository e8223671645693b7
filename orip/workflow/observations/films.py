"""What is measured when digitising begins, and where films lie on their stages.

The measurement texts tell, with the log that is being written: what was digitised counts at once, whether 'orip
measure' has read it or not, and a session that was interrupted is taken up where it ended.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import TypeVar

import numpy as np
from msgspec import Struct

from orip.errors import ProjectWarning, UsageError
from orip.files.log.text import read_measurements
from orip.files.text.regular_file import file_of
from orip.geometry.plane import IDENTITY, PlaneTransformation
from orip.interior.definitions import Definitions
from orip.interior.image_coordinates import scan_transformation
from orip.interior.in_force import Interior, stored_to_log
from orip.interior.mounting import chosen_marks
from orip.interior.replay import replay
from orip.records.definition import BundleDefinition, plan_stages
from orip.records.measurement import EditRecord, LogRecord, Measured, MeasuredMarks, PhotoRecord, TemplateRecord
from orip.records.names import near_names, record_key
from orip.records.photo import Photo, Scan, Stage, Template
from orip.structs import replace
from orip.workflow.observations.measure import with_digitised
from orip.workflow.project.folder import ProjectFolder
from orip.workflow.project.state import Part, ProjectState, read_project
from orip.workflow.project.texts import is_measurement_file, raise_complaints

Position = tuple[float, float]
"""On a stage plate."""

Marked = TypeVar("Marked", TemplateRecord, PhotoRecord)
Defined = TypeVar("Defined", Template, Photo)

_NO_MARKS = MeasuredMarks((), np.empty((0, 2)), np.empty(0, dtype=bool), np.empty((0, 2)))


class MountedFilms(Struct, frozen=True, dict=True):
    """A project as its measurement texts leave it, with the log that is being written.

    Parameters
    ----------
    state : ProjectState
        Its definitions have digitised marks, and what is measured comes from the texts instead of the stores.
    log : Path
        Where measurements are written to.
    records : tuple of LogRecord
        Of all texts, in the order of replay.
    """

    state: ProjectState
    log: Path
    records: tuple[LogRecord, ...]
    warnings: tuple[ProjectWarning, ...]

    @property
    def project(self) -> ProjectFolder:
        """Return the project."""
        return self.state.project

    @property
    def definitions(self) -> Definitions:
        """Return the records of the project by `record_key` of their names."""
        return self.state.records

    @property
    def measured(self) -> Measured:
        """Return what is measured."""
        return self.state.measured

    @property
    def interior(self) -> Interior:
        """Return the interior orientation."""
        return self.state.interior

    @property
    def shown_log(self) -> str:
        """Return the log as the user would name it."""
        return self.project.shown(self.log)

    def bundle(self, name: str | None) -> BundleDefinition:
        """Return a bundle; None: the project's only one."""
        return self.state.definitions.bundle(self.project.bundle_name(name))

    def template(self, name: str) -> Template:
        """Return a template; raise UsageError, with names like it, if there is none."""
        return _defined(self.definitions.templates, "template", name)

    def photo(self, name: str) -> Photo:
        """Return a photo; raise UsageError, with names like it, if there is none."""
        return _defined(self.definitions.photos, "photo", name)

    @cached_property
    def stages(self) -> Mapping[str, Stage]:
        """Return the stage of every photo (`record_key`) that has one: as mounted, else as defined, else by models."""
        mounted = [
            replace(template, stage=self.measured.templates[key].stage or template.stage)
            if key in self.measured.templates
            else template
            for key, template in self.definitions.templates.items()
        ]
        models = [model for bundle in self.state.definitions.bundles for model in bundle.record.models]
        return plan_stages(tuple(self.definitions.photos.values()), mounted, models).stages

    def stage_of(self, photo: str) -> Stage:
        """Return the stage of a photo; raise UsageError if nothing tells."""
        stage = self.stages.get(record_key(photo))
        if stage is None:
            message = (
                f'the stage of photo {photo} is not known; give it (or its template) stage = "UPPER" or '
                "\"LOWER\" in orip.toml and run 'orip init'"
            )
            raise UsageError(message)
        return stage

    def plate_of_stored(self, photo: Photo) -> PlaneTransformation | None:
        """Return stored coordinates of a photo to plate units; None where its template is not oriented."""
        to_log = stored_to_log(photo, self.definitions, self.interior.to_template)
        return to_log and plate_of_log(self.scan_of(photo)).after(to_log)

    def scan_of(self, photo: Photo) -> Scan | None:
        """Return the scan that a photo is measured in."""
        template = self.definitions.template_of(photo)
        return photo.scan or (template.scan if template else None)

    def ticks_on_plate(self, template: Template) -> MeasuredMarks:
        """Return the tick marks of a template as last measured, plate mm; also too few of them for an orientation."""
        found = self.measured.templates.get(record_key(template.name))
        if found is not None:
            return found.marks
        last = self._last(TemplateRecord, template.name)
        return _NO_MARKS if last is None else _on_plate(self._left(*last), template.scan)

    def fiducials_on_plate(self, photo: Photo) -> MeasuredMarks:
        """Return the fiducial marks of a photo as last measured, where they are on the plate now."""
        found, to_plate = self.measured.photos.get(record_key(photo.name)), self.plate_of_stored(photo)
        if found is not None and to_plate is not None:
            return replace(found.marks, measured=to_plate.apply(found.marks.measured))
        last = self._last(PhotoRecord, photo.name)
        mounted = self._last(TemplateRecord, photo.template) if photo.template is not None else None
        if last is None or (mounted is not None and mounted[0] > last[0]):
            return _NO_MARKS
        return _on_plate(self._left(*last), self.scan_of(photo))

    def points_on_plate(self, bundle: str) -> dict[tuple[str, str], Position]:
        """Return by (photo key, point) where measured points of a bundle are on the plate now."""
        found = self.measured.observations.get(record_key(bundle))
        if found is None:
            return {}
        photos = {record_key(name) for name in found.photos}
        to_plate = {key: self.plate_of_stored(self.definitions.photos[key]) for key in photos}
        places: dict[tuple[str, str], Position] = {}
        for name, point, xy in zip(found.photos, found.points, found.measured, strict=True):
            transformation = to_plate[record_key(name)]
            if transformation is not None:
                places[record_key(name), point] = position(transformation, xy)
        return places

    def _last(self, kind: type[Marked], name: str) -> tuple[int, Marked] | None:
        """Return the last record of a kind for a template or photo, and its place in the log."""
        for place in reversed(range(len(self.records))):
            record = self.records[place]
            if isinstance(record, kind) and record_key(_owner(record)) == record_key(name):
                return place, record
        return None

    def _left(self, place: int, record: TemplateRecord | PhotoRecord) -> MeasuredMarks:
        """Return the marks of the last record of a film without those that were killed since."""
        what, owner = "TICK" if isinstance(record, TemplateRecord) else "MARK", record_key(_owner(record))
        killed = {
            edit.name
            for edit in self.records[place:]
            if isinstance(edit, EditRecord)
            and (edit.action, edit.what) == ("KILL", what)
            and (edit.owner == "*" or record_key(edit.owner) == owner)
        }
        rows = [row for row, name in enumerate(record.marks.names) if not killed & {name, "*"}]
        return chosen_marks(record.marks, rows)


def mounted_films(folder: Path, log: Path, *parts: Part) -> MountedFilms:
    """Read a project, its measurement texts and the log, and replay them.

    What keeps a replay from being complete, such as a template of which only two tick marks are digitised yet, becomes
    a warning: it may be what is digitised next.

    Parameters
    ----------
    log : Path
        Where measurements will be written to, relative to the project folder; need not exist.
    parts : Part
        What to read of the stores besides the definitions.

    Raises
    ------
    InputError
        If the project is not initialised, or a text cannot be read.
    """
    state = read_project(folder, "definitions", *parts)
    state.require_initialised()
    path = state.project.folder / log
    films = _replayed(state, path, log_records(state.project, _files(state, path)))
    return replace(films, warnings=(*_not_in_project(state.project, path), *films.warnings))


def films_of(films: MountedFilms, files: Sequence[Path]) -> MountedFilms:
    """Return the same films as other measurement files leave them, relative ones in the project folder.

    Raises
    ------
    InputError
        If they cannot be read.
    """
    records = log_records(films.project, [films.project.folder / path for path in files])
    return _replayed(films.state, films.log, records)


def _replayed(state: ProjectState, log: Path, records: tuple[LogRecord, ...]) -> MountedFilms:
    replayed = replay(records, state.records, Measured())
    definitions = with_digitised(state.definitions, replayed.measured)
    unfinished = tuple(
        ProjectWarning("not-complete", f"{fault.path}:{fault.line}" if fault.line else fault.path, fault.message)
        for fault in replayed.complaints
    )
    mounted = state.with_stored(replace(state.stored, definitions=definitions, measured=replayed.measured))
    return MountedFilms(mounted, log, records, unfinished)


def log_records(project: ProjectFolder, files: Sequence[Path]) -> tuple[LogRecord, ...]:
    """Read measurement texts one after the other.

    Raises
    ------
    InputError
        With everything that is wrong in them.
    """
    read = [read_measurements(path, project.shown(path)) for path in files]
    raise_complaints([complaint for log in read for complaint in log.complaints])
    return tuple(record for log in read for record in log.value)


def plate_of_log(scan: Scan | None) -> PlaneTransformation:
    """Return coordinates of a log to plate units: pixels of a scan to mm, all others as they are."""
    return scan_transformation(scan) if scan is not None else IDENTITY


def position(transformation: PlaneTransformation, xy: Sequence[float] | np.ndarray) -> Position:
    """Return one transformed position."""
    x, y = transformation.apply(np.array([xy]))[0].tolist()
    return x, y


def _files(state: ProjectState, log: Path) -> list[Path]:
    """Return the measurement files that exist, with the log."""
    listed = list(state.texts.measurement_files.value)
    if log.exists() and file_of(log) not in {file_of(path) for path in listed}:
        listed.append(log)
    return listed


def _not_in_project(project: ProjectFolder, log: Path) -> Iterator[ProjectWarning]:
    if not is_measurement_file(project, log):
        text = (
            "is not among the project's measurement_files: 'orip measure' and 'orip run' will not replay it; add it to "
            "measurement_files in orip.toml"
        )
        yield ProjectWarning("not-in-project", project.shown(log), text)


def _on_plate(marks: MeasuredMarks, scan: Scan | None) -> MeasuredMarks:
    return replace(marks, measured=plate_of_log(scan).apply(marks.measured))


def _owner(record: TemplateRecord | PhotoRecord) -> str:
    return record.template if isinstance(record, TemplateRecord) else record.photo


def _defined(records: Mapping[str, Defined], kind: str, name: str) -> Defined:
    found = records.get(record_key(name))
    if found is None:
        near = near_names(name, (defined.name for defined in records.values()))
        message = f"{kind} {name} is not defined; {near}"
        raise UsageError(message)
    return found
