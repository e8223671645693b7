"""`orip update --undo`: the preliminary values that the last update replaced come back."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from msgspec import Struct
from msgspec.structs import asdict

from orip.errors import Complaint, InputError
from orip.files.result.before_update import before_update_text, read_before_update
from orip.files.stores.contents.definitions import NamedRecord, StoredRecord
from orip.files.stores.digest import record_digest
from orip.files.text.regular_file import text_digest
from orip.records.names import record_key
from orip.records.results.stations import BeforeUpdate, RecordBefore, TextBefore
from orip.structs import replace
from orip.workflow.project.commit import Change
from orip.workflow.project.folder import ProjectFolder
from orip.workflow.project.outputs import EditedText, digest_of_text
from orip.workflow.project.state import Part, ProjectState, StoredParts

UNDONE_FROM: tuple[Part, ...] = ("definitions",)
"""What undoing needs of the stores."""

_REMEDY = "the file is unchanged, and nothing was updated"


class UndoOutcome(Struct, frozen=True):
    """What `orip update --undo` did: the kind, where it is stored, and the names that have their old values again."""

    project: ProjectFolder
    what: str
    bundle: str
    path: Path
    names: tuple[str, ...]


def before_update_file(project: ProjectFolder, before: BeforeUpdate) -> EditedText:
    """Return the file that lets an update be undone, which is written before the update."""
    path = project.before_update
    return EditedText(path, digest_of_text(path), before_update_text(before), _REMEDY)


def text_before(path: Path, edited: EditedText) -> TextBefore:
    """Return what an update changes of a text."""
    return TextBefore(path.read_bytes().decode("utf-8") if path.exists() else None, text_digest(edited.text))


def record_before(old: NamedRecord, new: NamedRecord) -> RecordBefore:
    """Return what an update has changed of a record."""
    now = asdict(new)  # type: ignore[arg-type]
    before = asdict(old)  # type: ignore[arg-type]
    changed = tuple((name, value) for name, value in before.items() if value != now[name])
    return RecordBefore(old.name, changed, record_digest(new))


def undo_update(state: ProjectState) -> Change[UndoOutcome]:
    """Return the change that undoes the last update; nothing is written.

    Parameters
    ----------
    state : ProjectState
        With `UNDONE_FROM`.

    Raises
    ------
    InputError
        If there is no update to undo, or something that it changed has been changed again since, which is named.
    """
    project = state.project
    before = read_before_update(project.before_update, project.shown(project.before_update))
    if before.what == "points":
        return _of_points(state, before)
    old = state.definitions
    stored: Sequence[StoredRecord[Any]] = old.cameras if before.what == "cameras" else old.photos
    restored, names = _restored(stored, before)
    new = replace(old, cameras=restored) if before.what == "cameras" else replace(old, photos=restored)
    path = project.cameras if before.what == "cameras" else project.photos
    outcome = UndoOutcome(project, before.what, before.bundle, path, names)
    return Change(state, outcome, StoredParts(new), project.record_stores, superseded=(project.before_update,))


def _restored(
    stored: Sequence[StoredRecord[Any]], before: BeforeUpdate
) -> tuple[tuple[StoredRecord[Any], ...], tuple[str, ...]]:
    """Return the records with the fields that they had, and the names of those that the update had changed.

    Those that have their old values already are left alone: an update that was killed before it was stored.
    """
    wanted = {record_key(record.name): record for record in before.records}
    records, names, complaints = [], [], []
    for item in stored:
        record = wanted.pop(record_key(item.record.name), None)
        old = item.record if record is None else replace(item.record, **dict(record.fields))
        if record is not None and record_digest(item.record) == record.updated:
            names.append(item.record.name)
        elif record_digest(old) != record_digest(item.record):
            complaints.append(_changed(before.what[:-1], item.record.name))
        records.append(replace(item, record=old))
    complaints += [_changed(before.what[:-1], record.name) for record in wanted.values()]
    if complaints:
        raise InputError(complaints)
    return tuple(records), tuple(names)


def _changed(kind: str, name: str) -> Complaint:
    return Complaint(
        f"{kind} {name} has been changed since the update, or is no longer defined: the update cannot be undone; "
        "nothing was changed"
    )


def _of_points(state: ProjectState, before: BeforeUpdate) -> Change[UndoOutcome]:
    project = state.project
    path = project.preliminary(before.bundle)
    text, now = before.text, digest_of_text(path)
    gone = (project.before_update,)
    if text is not None and now == (None if text.text is None else text_digest(text.text)):
        return Change(state, UndoOutcome(project, before.what, before.bundle, path, ()), superseded=gone)
    if text is None or now != text.updated:
        message = "it has been changed since the update, which cannot be undone; nothing was changed"
        raise InputError.single(message, project.shown(path))
    outcome = UndoOutcome(project, before.what, before.bundle, path, (path.name,))
    if text.text is None:
        return Change(state, outcome, superseded=(path, *gone))
    edited = EditedText(path, now, text.text, "the file is unchanged")
    return Change(state, outcome, locks=project.record_stores, edited_texts=(edited,), superseded=gone)
