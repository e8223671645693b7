"""What an edit does to records: added, renamed, changed value by value, deleted."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, Literal, get_args

from msgspec import Struct

from orip.files.project.record_values import TomlTable
from orip.records.names import record_key
from orip.workflow.records.references import DocumentRecord, RecordKind, records_of
from orip.workflow.records.values import RecordValue, values_of


class ValueChange(Struct, frozen=True):
    """A value before and after an edit; None: not given."""

    key: str
    old: Any
    new: Any
    unit: str


class RecordChange(Struct, frozen=True):
    """What an edit does to one record; a renamed one has its new name."""

    kind: RecordKind
    name: str
    action: Literal["added", "changed", "renamed", "deleted"]
    old_name: str = ""
    values: tuple[ValueChange, ...] = ()


class Renaming(Struct, frozen=True):
    """A record that has another name than before; `bundle` is that of a model, as it was called before."""

    kind: RecordKind
    old: str
    new: str
    bundle: str = ""


def record_changes(
    before: Mapping[str, Any], after: Mapping[str, Any], renaming: Renaming | None, ground_unit: str
) -> tuple[RecordChange, ...]:
    """Compare two documents record by record.

    Parameters
    ----------
    before, after : documents of orip.toml
    renaming : Renaming or None
    ground_unit : str
    """
    return tuple(
        change
        for kind in get_args(RecordKind)
        for change in _changes_of_kind(kind, before, after, renaming, ground_unit)
    )


def _changes_of_kind(
    kind: RecordKind,
    before: Mapping[str, Any],
    after: Mapping[str, Any],
    renaming: Renaming | None,
    ground_unit: str,
) -> Iterator[RecordChange]:
    old = {_name_now(record, renaming): record for record in records_of(before, kind)}
    for place in records_of(after, kind):
        known = old.pop((record_key(place.bundle), record_key(place.table["name"])), None)
        if known is None:
            yield RecordChange(kind, place.name, "added", values=tuple(_values(kind, {}, place.table, ground_unit)))
            continue
        values = tuple(_values(kind, known.table, place.table, ground_unit))
        if known.table["name"] != place.table["name"]:
            yield RecordChange(kind, place.name, "renamed", known.name, values)
        elif values:
            yield RecordChange(kind, place.name, "changed", values=values)
    for gone in old.values():
        yield RecordChange(kind, gone.name, "deleted")


def _name_now(place: DocumentRecord, renaming: Renaming | None) -> tuple[str, str]:
    """Return the key under which a record of the first document is found in the second."""
    bundle, name = record_key(place.bundle), record_key(place.table["name"])
    if renaming is not None:
        if renaming.kind == "bundle" and bundle == record_key(renaming.old):
            bundle = record_key(renaming.new)
        if (renaming.kind, record_key(renaming.old), record_key(renaming.bundle)) == (place.kind, name, bundle):
            name = record_key(renaming.new)
    return bundle, name


def _values(kind: RecordKind, old: TomlTable, new: TomlTable, ground_unit: str) -> Iterator[ValueChange]:
    # of nothing there are no values
    before = {value.key: value for value in values_of(kind, old, ground_unit)} if old else {}
    after = {value.key: value for value in values_of(kind, new, ground_unit)}
    for key in {**before, **after}:
        was, now = before.get(key, _NOTHING), after.get(key, _NOTHING)
        if was.value != now.value:
            yield ValueChange(key, was.value, now.value, now.unit or was.unit)


_NOTHING = RecordValue("", None, "")
