"""The columns of a store that the fields of a record have, and its values as rows and back."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cache
from itertools import islice
from typing import Any, Literal, get_args, get_origin

from msgspec import Struct, StructMeta

from orip.files.stores.store import Row
from orip.files.stores.table import Null, StoreColumn, all_or_none, integer, real, record_name, text
from orip.records.fields import RecordField, fields_by_column, fields_of, without_none


def columns_of(record: type) -> tuple[StoreColumn, ...]:
    """Return the columns of all fields of a record but its lists, which have tables of their own."""
    return tuple(column for record_field in _in_columns(record) for column in _columns(record_field))


def checks_of(record: type) -> tuple[str, ...]:
    """Return the conditions that values of several columns are known together, or not at all."""
    return tuple(
        all_or_none(*(column.name for column in _columns(record_field)))
        for record_field in _in_columns(record)
        if record_field.optional and len(_columns(record_field)) > 1
    )


def row_of(record: Any) -> Row:
    """Return the values of `columns_of` the record's class."""
    kind: type = type(record)
    return tuple(
        value
        for record_field in _in_columns(kind)
        for value in _values(record_field, getattr(record, record_field.name))
    )


def values_of(record: type, row: Sequence[Any]) -> dict[str, Any]:
    """Return the fields of a record by name from a row of `columns_of` its class."""
    values = iter(row)
    return {record_field.name: _value(record_field, values) for record_field in _in_columns(record)}


@cache
def _in_columns(record: type) -> tuple[RecordField, ...]:
    """Return the fields of a record that have columns, in their order."""
    return tuple(record_field for record_field in fields_by_column(record) if record_field.item is None)


def list_rows(items: Sequence[Any]) -> list[Row]:
    """Return the items of a list as rows: names, tuples or records."""
    return [_item_row(item) for item in items]


def _item_row(item: Any) -> Row:
    if isinstance(item, Struct):
        return row_of(item)
    return item if isinstance(item, tuple) else (item,)


def list_of(record_field: RecordField, rows: Sequence[Row]) -> tuple[Any, ...] | None:
    """Return a list field from its rows; None if it may be and there are none."""
    if not rows and record_field.optional:
        return None
    if record_field.item is str:
        return tuple(row[0] for row in rows)
    return (
        tuple(record_field.item(**values_of(record_field.item, row)) for row in rows)
        if _is_record(record_field.item)
        else tuple(rows)
    )


@cache
def _columns(record_field: RecordField, around: str = "", null: Null = "never") -> tuple[StoreColumn, ...]:
    """Return the columns of a field; `around` is the column name of the record that it is in."""
    name = _name(record_field, around)
    null = "none" if record_field.optional else null
    if _is_record(record_field.type):
        return tuple(column for inner in fields_of(record_field.type) for column in _columns(inner, name, null))
    is_limited = around != "" and record_field.field.above is not None
    if not record_field.field.elements:
        return (
            _column(
                record_field.type,
                name,
                null,
                record_field.field.names_record,
                f"{name} > {record_field.field.above}" * is_limited,
            ),
        )
    element = without_none(get_args(record_field.type)[0])
    null = "none" if element is not get_args(record_field.type)[0] else null
    names = (
        record_field.field.elements
        if record_field.field.parts
        else [f"{name}_{element}" for element in record_field.field.elements]
    )
    return tuple(
        _column(element, own, null, False, f"{own} > {record_field.field.above}" * is_limited) for own in names
    )


def _name(record_field: RecordField, around: str) -> str:
    """Return the name of a column; what is the value of the record around it has the name of that."""
    if not around:
        return record_field.field.column or record_field.name
    return around if record_field.name == "value" else f"{around}_{record_field.name}"


def _column(kind: Any, name: str, null: Null, names_record: bool, check: str) -> StoreColumn:
    if kind is float:
        return real(name, null, check)
    if kind is int:
        return integer(name, check, optional=null != "never")
    if names_record:
        return record_name(name, optional=null != "never")
    return text(name, get_args(kind) if get_origin(kind) is Literal else (), optional=null != "never")


def _values(record_field: RecordField, value: Any) -> Row:
    count = len(_columns(record_field))
    if value is None:
        return (None,) * count
    if _is_record(record_field.type):
        return tuple(
            part for inner in fields_of(record_field.type) for part in _values(inner, getattr(value, inner.name))
        )
    row = tuple(value) if record_field.field.elements else (value,)
    if len(row) != count:
        message = f"{record_field.name} has {len(row)} values, not {count}"
        raise ValueError(message)
    return row


def _value(record_field: RecordField, values: Iterator[Any]) -> Any:
    """Take the value of a field from those of a row."""
    own = tuple(islice(values, len(_columns(record_field))))
    if record_field.optional and own[0] is None:
        return None
    if _is_record(record_field.type):
        inner_values = iter(own)
        return record_field.type(**{inner.name: _value(inner, inner_values) for inner in fields_of(record_field.type)})
    return own if record_field.field.elements else own[0]


def _is_record(kind: Any) -> bool:
    return isinstance(kind, StructMeta)
