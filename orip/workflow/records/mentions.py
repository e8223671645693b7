"""The text files that still name a record that was renamed or deleted: no command writes into them."""

from __future__ import annotations

from collections.abc import Iterator

from orip.errors import ProjectWarning
from orip.records.names import record_key
from orip.records.observations.control import Control
from orip.records.observations.measurement import (
    EditRecord,
    FiducialsRecord,
    LogRecord,
    PhotoRecord,
    PointsRecord,
    TemplateRecord,
    TicksRecord,
)
from orip.workflow.project.definitions import StoredDefinitions
from orip.workflow.project.folder import ProjectFolder
from orip.workflow.project.state import ProjectState
from orip.workflow.records.changes import RecordChange


def mention_warnings(state: ProjectState, changes: tuple[RecordChange, ...]) -> Iterator[ProjectWarning]:
    """Warn of each text that still uses the old name of a record."""
    gone = [
        change
        for change in changes
        if change.action in {"renamed", "deleted"}
        and record_key(change.old_name) != record_key(change.name)
        and change.kind != "model"  # a model is part of its bundle, whose text is applied as a whole
    ]
    if not gone:
        return
    project = state.project
    log, control = state.texts.log.value.records, state.texts.control.value
    base = project.definition.control_files
    for change in gone:
        name = change.old_name or change.name
        now = f"is called {change.name} now" if change.old_name else "is deleted"
        yield from _in_project_text(project, change, name, now)
        yield from _shared(project, state.definitions, change, name)
        for path, line in dict(
            reversed([_place(record) for record in log if _mentions(record, change.kind, name)])
        ).items():
            text = f"{change.kind} {name} {now}, but is still measured here; correct it before the next 'orip measure'"
            yield ProjectWarning("still-in-measurements", f"{path}:{line}", text)
        for extension, line in _observed(control, change.kind, name):
            text = f"{change.kind} {name} {now}, but is still observed here; correct this line"
            yield ProjectWarning("still-in-control", f"{base}.{extension}:{line}", text)


def _observed(control: Control, kind: str, name: str) -> Iterator[tuple[str, int]]:
    """Iterate over the lines of control texts, with the extension of the text, that observe a record."""
    for element in control.elements:
        if element.group.lower() == kind and record_key(element.name) == record_key(name):
            yield "ELE", element.line
    for station in control.stations:
        if kind == "photo" and record_key(station.photo) == record_key(name):
            yield "STA", station.line


def _in_project_text(project: ProjectFolder, change: RecordChange, name: str, now: str) -> Iterator[ProjectWarning]:
    line = project.lines.get((change.kind, record_key(name)))
    if line is not None:
        text = (
            f"{change.kind} {name} {now}, but is still in the text, and the next 'orip init' brings it back; correct "
            f"the text, or let 'orip export-toml --output orip.toml --force' do it"
        )
        yield ProjectWarning("still-in-text", f"{project.shown(project.text)}:{line}", text)


def _shared(
    project: ProjectFolder, before: StoredDefinitions, change: RecordChange, name: str
) -> Iterator[ProjectWarning]:
    stored = before.cameras if change.kind == "camera" else before.temticks if change.kind == "temtick" else ()
    for record in stored:
        if record_key(record.record.name) == record_key(name) and record.origin not in {None, project.definition.name}:
            text = f"comes from project {record.origin}, which may still use it"
            yield ProjectWarning("shared-record", f"{change.kind} {name}", text)


def _place(record: LogRecord) -> tuple[str, int]:
    return record.place.path, record.place.line


def _mentions(record: LogRecord, kind: str, name: str) -> bool:
    return record_key(name) in {record_key(mentioned) for mentioned in _names(record, kind)}


def _names(record: LogRecord, kind: str) -> Iterator[str]:
    """Iterate over the names of records of a kind in a record of a measurement log."""
    match kind, record:
        case ("photo", PointsRecord() | PhotoRecord()):
            yield record.photo
        case ("photo", EditRecord()):
            yield record.owner if record.what != "TICK" else ""
        case ("template", EditRecord()):
            yield record.owner if record.what == "TICK" else ""
        case ("bundle", PointsRecord()):
            yield record.bundle
        case ("bundle", EditRecord()):
            yield record.bundle or ""
        case ("template", TemplateRecord()):
            yield record.template
        case ("camera", FiducialsRecord()):
            yield record.camera
        case ("temtick", TicksRecord()):
            yield record.temtick
