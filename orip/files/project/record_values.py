"""A record as a table of orip.toml, and back."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, TypeAlias, TypeVar, cast, get_args

from msgspec import Struct

from orip.records.definition import Precision
from orip.records.fields import Part, RecordField, fields_by_key, fields_of

TomlTable: TypeAlias = dict[str, Any]
"""A table as the TOML reader gives it; keys without a value are missing."""

T = TypeVar("T")


def record_of(record: type[T], table: Mapping[str, Any]) -> T:
    """Return the record that a table says, as its form has read it; a key that is missing has the record's default."""
    given, kind = {}, cast(type, record)
    for record_field in fields_of(kind):
        if record_field.field.parts:
            values = (value for part in record_field.field.parts for value in _elements(part, table))
            # a camera with the lens of another one has no principal distance of its own: not a number
            optional = float not in get_args(record_field.type)
            given[record_field.name] = tuple(math.nan if value is None and not optional else value for value in values)
        elif record_field.key in table:
            given[record_field.name] = _value(record_field, table[record_field.key])
    return record(**given)


def _elements(part: Part, table: Mapping[str, Any]) -> Sequence[Any]:
    value = table.get(part.key)
    if part.names:
        return [(value or {}).get(name, 0.0) for name in part.names]
    if part.size > 1:
        return (0.0,) * part.size if value is None else value
    return (part.default if value is None else value,)


def _value(record_field: RecordField, value: Any) -> Any:
    if record_field.field.names:
        return tuple(value.get(name, 0.0) for name in record_field.field.names)
    return _converted(record_field.item or record_field.type, value)


def _converted(kind: Any, value: Any) -> Any:
    """Return a checked value as records hold it: tuples in place of lists, structures in place of tables."""
    if isinstance(value, dict):
        return record_of(kind, value)
    if isinstance(value, list):
        return tuple(_converted(kind, item) for item in value)
    return value


def toml_of(record: Any) -> TomlTable:
    """Return a record as a table of orip.toml; what is None or an empty list has no key."""
    return {
        key: value
        for record_field in fields_by_key(type(record))
        for key, value in _keys_of(record_field, getattr(record, record_field.name))
        if value is not None and value not in ([], {})
    }


def _keys_of(record_field: RecordField, value: Any) -> Iterator[tuple[str, Any]]:
    if not record_field.field.parts:
        named = record_field.field.names and value is not None
        yield record_field.key, dict(zip(record_field.field.names, value, strict=True)) if named else _plain(value)
    first = 0
    for part in record_field.field.parts:
        elements = value[first : first + part.size]
        first += part.size
        if part.names:
            yield part.key, {name: element for name, element in zip(part.names, elements, strict=True) if element}
        else:
            given = elements[0] if part.size == 1 else list(elements)
            yield part.key, None if given == part.default else given


def _plain(value: Any) -> Any:
    """Return a value of a record as TOML has it."""
    if isinstance(value, Precision):
        return value.value if value.unit == "mm" else f"{value.value}px"
    if isinstance(value, tuple):
        return [_plain(item) for item in value]
    return toml_of(value) if isinstance(value, Struct) else value
