"""Text against stores: which of the two has changed a record since the text was last applied."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Any, Generic, Literal, TypeVar

from msgspec import Struct
from msgspec.structs import asdict

from orip.files.stores.contents.definitions import NamedRecord, StoredRecord
from orip.files.stores.digest import record_digest
from orip.records.names import record_key
from orip.records.project.camera import CAMERA_PARAMETERS
from orip.records.project.photo import PHOTO_PARAMETERS
from orip.wording import counted

Prefer = Literal["text", "store"]
Action = Literal["added", "changed", "removed", "detached"]

T = TypeVar("T", bound=NamedRecord)


class AppliedChange(Struct, frozen=True):
    """What applying the text does to one record."""

    kind: str
    name: str
    action: Action


class Conflict(Struct, frozen=True):
    """A record that text and store have both changed; `text` names the values on both sides."""

    kind: str
    name: str
    text: str


class Reconciled(Struct, Generic[T], frozen=True):
    """The records that the store should hold (unchanged where there is a conflict), the changes, and the conflicts."""

    records: tuple[StoredRecord[T], ...]
    changes: tuple[AppliedChange, ...]
    conflicts: tuple[Conflict, ...]


def counted_changes(changes: Sequence[AppliedChange]) -> str:
    """Return '1 camera changed, 15 photos added'."""
    counts = Counter((change.kind, change.action) for change in changes)
    return ", ".join(f"{counted(count, kind)} {action}" for (kind, action), count in counts.items())


def reconcile(
    kind: str,
    texts: Sequence[T],
    stored: Sequence[StoredRecord[T]],
    project: str,
    prefer: Prefer | None,
    shared: bool,
) -> Reconciled[T]:
    """Apply the records of a text to those of a store, each only where the text has changed.

    Parameters
    ----------
    kind : str
        What the records are, for messages.
    texts : sequence of records
    stored : sequence of StoredRecord
    project : str
        Name of the project that the text belongs to.
    prefer : {"text", "store"} or None
        Which side wins where both have changed; None: neither, that is a conflict.
    shared : bool
        The store may serve other projects: their records stay, and records gone from this text stay too.

    Returns
    -------
    Reconciled
    """
    by_key = {record_key(item.record.name): item for item in stored}
    records: list[StoredRecord[T]] = []
    changes: list[AppliedChange] = []
    conflicts: list[Conflict] = []
    for text in texts:
        old = by_key.pop(record_key(text.name), None)
        verdict = _verdict(text, old, project, prefer)
        if isinstance(verdict, str):
            conflicts.append(Conflict(kind, text.name, verdict))
            records += [old] if old is not None else []
            continue
        records.append(verdict)
        if old is None or verdict.record != old.record:
            changes.append(AppliedChange(kind, text.name, "added" if old is None else "changed"))
    for old in by_key.values():
        gone = old.text_digest is not None and old.origin == project
        edited = gone and record_digest(old.record) != old.text_digest
        if not gone:
            records.append(old)
        elif shared or (edited and prefer == "store"):
            records.append(StoredRecord(old.record))
            changes.append(AppliedChange(kind, old.record.name, "detached"))
        elif edited and prefer is None:
            conflicts.append(Conflict(kind, old.record.name, "was removed from the text but was changed in the store"))
            records.append(old)
        else:
            changes.append(AppliedChange(kind, old.record.name, "removed"))
    return Reconciled(tuple(records), tuple(changes), tuple(conflicts))


def _verdict(text: T, old: StoredRecord[T] | None, project: str, prefer: Prefer | None) -> StoredRecord[T] | str:
    """Return the record to keep, or what the conflict is."""
    digest = record_digest(text)
    applied = StoredRecord(text, digest, project)
    if old is None:
        return applied
    if old.text_digest == digest:
        return old
    kept = record_digest(old.record)
    if kept == digest:
        return applied
    foreign = old.origin is not None and old.origin != project
    if (kept == old.text_digest and not foreign) or prefer == "text":
        return applied
    if prefer == "store":
        return StoredRecord(old.record, digest, project)
    if foreign:
        found = f"comes from project {old.origin}"
    elif old.text_digest is None:
        found = "is in the store already, from no text of this project"
    else:
        found = "was changed both in the text and in the store"
    return f"{found}: {'; '.join(differences(text, old.record))}"


def differences(text: object, store: object) -> list[str]:
    """Return 'C is 8.6 in the text and 8.595 in the store' for each value in which two records differ."""
    found = []
    in_store = asdict(store)  # type: ignore[arg-type]
    for field, value in asdict(text).items():  # type: ignore[arg-type]
        for name, a, b in _named_values(field, value, in_store[field]):
            if a != b:
                found.append(f"{name} is {_shown(a)} in the text and {_shown(b)} in the store")
    return found


_PARTS = {
    ("parameters", len(CAMERA_PARAMETERS)): CAMERA_PARAMETERS,
    ("orientation", len(PHOTO_PARAMETERS)): PHOTO_PARAMETERS,
}


def _named_values(name: str, a: Any, b: Any) -> list[tuple[str, Any, Any]]:
    names = _PARTS.get((name, len(a))) if isinstance(a, tuple) else None
    return list(zip(names, a, b, strict=True)) if names else [(name, a, b)]


def _shown(value: Any) -> str:
    if value is None or value == ():
        return "not given"
    if isinstance(value, tuple):
        return "[" + ", ".join(_shown(getattr(item, "name", item)) for item in value) + "]"
    return str(value)
