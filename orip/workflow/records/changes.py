"""What an edit does to records: added, renamed, changed value by value, deleted; and their values one by one."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import cache
from typing import Any, Literal, NamedTuple, get_args

from msgspec import Struct

from orip.files.project.tables import keys_of, table_of
from orip.files.project.toml_text import TomlTable, toml_value
from orip.records.definition import RECORD_TYPES
from orip.records.fields import GROUND_UNIT, units_of
from orip.records.names import record_key
from orip.workflow.records.document import DocumentRecord, RecordKind, records_of

NOT_GIVEN = "-"


class RecordValue(NamedTuple):
    """A value of a record: its key, its value as TOML has it (None: not given), and its unit."""

    key: str
    value: Any
    unit: str

    @property
    def text(self) -> str:
        """Return the value as it is shown."""
        return shown_value(self.value)


def shown_value(value: Any) -> str:
    """Return a value as orip.toml has it, a text without quotation marks."""
    if value is None:
        return NOT_GIVEN
    return value if isinstance(value, str) else toml_value(value)


def values_of(kind: RecordKind, table: Mapping[str, Any], ground_unit: str) -> list[RecordValue]:
    """Return all values of a record except its name; nested tables are flattened, and what is not given is None."""
    values = []
    for key in _keys(kind):
        flat = dict(_flat(key, table.get(key)))
        values += [RecordValue(path, value, _unit(kind, path, value, ground_unit)) for path, value in flat.items()]
    return values


@cache
def _keys(kind: RecordKind) -> tuple[str, ...]:
    return tuple(key for key in keys_of(table_of(RECORD_TYPES[kind])) if key != "name")


@cache
def _units(kind: RecordKind) -> Mapping[str, str]:
    return dict(units_of(RECORD_TYPES[kind]))


def _flat(path: str, value: Any) -> Iterator[tuple[str, Any]]:
    if isinstance(value, dict):
        for key, inner in value.items():
            yield from _flat(f"{path}.{key}", inner)
    elif isinstance(value, list) and value and isinstance(value[0], dict):
        for item in value:
            yield from _flat(f"{path}.{item['name']}", {key: item[key] for key in item if key != "name"})
    else:
        yield path, None if value == [] else value


def _unit(kind: RecordKind, path: str, value: Any, ground_unit: str) -> str:
    if path == "measurement_precision" and isinstance(value, str):
        return ""  # the text includes its unit
    unit = _stated_unit(kind, path)
    return ground_unit if unit == GROUND_UNIT else unit


@cache
def _stated_unit(kind: RecordKind, path: str) -> str:
    units = _units(kind)
    return units.get(path) or units.get(f"{path.partition('.')[0]}.*.{path.rpartition('.')[2]}", "")


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
    """Compare two documents record by record."""
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
