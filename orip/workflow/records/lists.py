"""`list` and `show` of the record commands: records as the stores hold them, and where each came from."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from msgspec import Struct

from orip.files.project.record_values import TomlTable
from orip.files.stores.contents.definitions import NamedRecord, StoredRecord
from orip.files.stores.digest import record_digest
from orip.files.text.shown import visible
from orip.files.text.table import Column, table_lines
from orip.records.names import record_key
from orip.records.project.camera import CAMERA_PARAMETERS, RADIAL_PARAMETERS, Camera
from orip.records.project.definition import RECORD_TYPES
from orip.records.project.fields import headings_of
from orip.workflow.project.definitions import StoredDefinitions
from orip.workflow.project.folder import PROJECT_FILE, ProjectFolder
from orip.workflow.project.state import ProjectState
from orip.workflow.records.changes import RecordValue, shown_value, values_of
from orip.workflow.records.document import DocumentRecord, RecordKind, records_of, referents, stored_document
from orip.workflow.records.edits import RecordName, bundle_of_models, find
from orip.workflow.records.reconcile import with_polynomial


class RecordRow(Struct, frozen=True):
    """A record: its bundle (of a model), its name, its table of orip.toml, and where it came from."""

    bundle: str
    name: str
    table: TomlTable
    source: str


class RecordList(Struct, frozen=True):
    """The records of a kind, also as text."""

    rows: tuple[RecordRow, ...]
    text: str


class ShownRecord(Struct, frozen=True):
    """A record with all its values, and what names it."""

    row: RecordRow
    values: tuple[RecordValue, ...]
    named_by: tuple[str, ...]
    text: str


def list_records(state: ProjectState, kind: RecordKind, bundle: str | None = None) -> RecordList:
    """Return the records of a kind in the order of their store; models of one bundle, or of all.

    Parameters
    ----------
    state : ProjectState
        With definitions.
    kind : str
    bundle : str or None

    Raises
    ------
    UsageError
        If there is no such bundle.
    """
    project, stored = state.project, state.definitions
    document = stored_document(project, stored)
    chosen = bundle_of_models(document, bundle)["name"] if bundle is not None else None
    places = [place for place in records_of(document, kind) if chosen in {None, place.bundle}]
    rows = tuple(_row(project, stored, place) for place in places)
    columns = [Column("Name", [row.name for row in rows], align="left")]
    for heading, key, counted in headings_of(RECORD_TYPES[kind]):
        columns.append(Column(heading, [_cell(row.table, key, counted=counted) for row in rows], align="left"))
    if kind == "model":
        columns.insert(0, Column("Bundle", [row.bundle for row in rows], align="left"))
    columns.append(Column("From", [row.source for row in rows], align="left"))
    return RecordList(rows, "\n".join(table_lines(columns)) + "\n")


def show_record(state: ProjectState, record: RecordName) -> ShownRecord:
    """Return a record with all its values; raises what `list_records` does."""
    project, stored = state.project, state.definitions
    document = stored_document(project, stored)
    place = find(document, record)
    row = _row(project, stored, place)
    values = tuple(values_of(record.kind, place.table, project.definition.ground_unit))
    named_by = tuple(
        f"{referent.kind} {referent.name}" for referent in referents(document, record.kind, place.table["name"])
    )
    lines = [f"{record.kind} {place.name}", *_value_lines(values), ""]
    if record.kind == "camera":
        lines += _polynomial_lines(state.definitions.cameras, place.table)
    lines.append(f"  from      {row.source}")
    lines.append(f"  named by  {', '.join(named_by) or 'no record'}")
    return ShownRecord(row, values, named_by, "\n".join(lines) + "\n")


def _polynomial_lines(cameras: Sequence[StoredRecord[Camera]], table: TomlTable) -> list[str]:
    """Return the coefficients with which a camera computes whose radial distortion is given in another form."""
    form = next((form for form in ("distortion_isp", "distortion_curve") if form in table), None)
    if form is None:
        return []
    camera = next(stored.record for stored in cameras if record_key(stored.record.name) == record_key(table["name"]))
    known = dict(zip(CAMERA_PARAMETERS, camera.parameters, strict=True))
    shown = ", ".join(f"{name} {known[name]:.6g}" for name in RADIAL_PARAMETERS if known[name])
    return [f"  radial    {shown or 'no distortion'} (from {form})"]


def _value_lines(values: Iterable[RecordValue]) -> list[str]:
    listed = list(values)
    columns = [
        Column("Key", [value.key for value in listed], align="left"),
        Column("Value", [value.text for value in listed], align="left"),
        Column("Unit", [value.unit for value in listed], align="left"),
    ]
    return table_lines(columns)


def _cell(table: Mapping[str, Any], key: str, *, counted: bool) -> str:
    if key == "distortion":
        forms = {"distortion_isp": "ISP", "distortion_curve": "curve", "distortion": "polynomial"}
        return next((forms[key] for key in forms if key in table), "none")
    if key == "fiducials" and "sensor" in table:
        return "sensor"
    return str(len(table.get(key, ()))) if counted else shown_value(table.get(key))


def _row(project: ProjectFolder, stored: StoredDefinitions, place: DocumentRecord) -> RecordRow:
    kind, name = ("bundle", place.bundle) if place.kind == "model" else (place.kind, place.table["name"])
    known: tuple[StoredRecord[NamedRecord], ...] = getattr(stored, f"{kind}s")
    record = next(candidate for candidate in known if record_key(candidate.record.name) == record_key(name))
    return RecordRow(place.bundle, place.table["name"], place.table, _source(project, kind, record))


def _source(project: ProjectFolder, kind: str, stored: StoredRecord[NamedRecord]) -> str:
    """Say where a record came from, and whether it or the text has changed since."""
    if stored.text_digest is None:
        return "no text"
    kept, key = record_digest(stored.record), record_key(stored.record.name)
    changed = ["in the store"] if kept != stored.text_digest else []
    line = project.lines.get((kind, key))
    if stored.origin != project.definition.name:
        place = f"project {visible(stored.origin or '')}"
    elif line is None:
        place = f"{PROJECT_FILE} as it was"
    else:
        place = f"{PROJECT_FILE}:{line}"
        records: tuple[NamedRecord, ...] = getattr(project.definition, f"{kind}s")
        text: Any = next(record for record in records if record_key(record.name) == key)
        now = record_digest(with_polynomial(text) if kind == "camera" else text)
        changed += ["in the text"] if now != stored.text_digest else []
        if now == kept:
            return place
    return f"{place}, changed {' and '.join(changed)}" if changed else place
