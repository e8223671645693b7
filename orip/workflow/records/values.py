"""The values of a record one by one, under the keys with which they are edited, with their units."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import cache
from typing import Any, NamedTuple

from orip.files.project.tables import keys_of, table_of
from orip.files.project.toml_text import toml_value
from orip.records.project.definition import RECORD_TYPES
from orip.records.project.fields import GROUND_UNIT, units_of
from orip.workflow.records.references import RecordKind

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
