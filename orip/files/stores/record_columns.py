"""The columns of a store that the fields of a record have, and its values as rows and back."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import is_dataclass
from itertools import islice
from typing import Any, Literal, get_args, get_origin

from orip.files.stores.store import Row
from orip.files.stores.table import Null, StoreColumn, all_or_none, integer, real, record_name, text
from orip.records.fields import RecordField, fields_by_column, fields_of, without_none


def columns_of(record: type) -> tuple[StoreColumn, ...]:
    """Return the columns of all fields of a record but its lists, which have tables of their own."""
    return tuple(column for each in fields_by_column(record) if each.item is None for column in _columns(each))


def checks_of(record: type) -> tuple[str, ...]:
    """Return the conditions that values of several columns are known together, or not at all."""
    return tuple(
        all_or_none(*(column.name for column in _columns(each)))
        for each in fields_by_column(record)
        if each.item is None and each.optional and len(_columns(each)) > 1
    )


def row_of(record: Any) -> Row:
    """Return the values of `columns_of` the record's dataclass."""
    fields = fields_by_column(type(record))
    return tuple(value for each in fields if each.item is None for value in _values(each, getattr(record, each.name)))


def values_of(record: type, row: Sequence[Any]) -> dict[str, Any]:
    """Return the fields of a record by name from a row of `columns_of` its dataclass."""
    values = iter(row)
    return {each.name: _value(each, values) for each in fields_by_column(record) if each.item is None}


def list_rows(items: Sequence[Any]) -> list[Row]:
    """Return the items of a list as rows: names, tuples or records."""
    return [row_of(item) if is_dataclass(item) else item if isinstance(item, tuple) else (item,) for item in items]


def list_of(each: RecordField, rows: Sequence[Row]) -> tuple[Any, ...] | None:
    """Return a list field from its rows; None if it may be and there are none."""
    if not rows and each.optional:
        return None
    if each.item is str:
        return tuple(row[0] for row in rows)
    return tuple(each.item(**values_of(each.item, row)) for row in rows) if _is_record(each.item) else tuple(rows)


def _columns(each: RecordField, around: str = "", null: Null = "never") -> tuple[StoreColumn, ...]:
    """Return the columns of a field; `around` is the column name of the record that it is in."""
    name = _name(each, around)
    null = "none" if each.optional else null
    if _is_record(each.type):
        return tuple(column for inner in fields_of(each.type) for column in _columns(inner, name, null))
    is_limited = around != "" and each.field.above is not None
    if not each.field.elements:
        return (_column(each.type, name, null, each.field.names_record, f"{name} > {each.field.above}" * is_limited),)
    element = without_none(get_args(each.type)[0])
    null = "none" if element is not get_args(each.type)[0] else null
    names = each.field.elements if each.field.parts else [f"{name}_{element}" for element in each.field.elements]
    return tuple(_column(element, own, null, False, f"{own} > {each.field.above}" * is_limited) for own in names)


def _name(each: RecordField, around: str) -> str:
    """Return the name of a column; what is the value of the record around it has the name of that."""
    if not around:
        return each.field.column or each.name
    return around if each.name == "value" else f"{around}_{each.name}"


def _column(kind: Any, name: str, null: Null, names_record: bool, check: str) -> StoreColumn:
    if kind is float:
        return real(name, null, check)
    if kind is int:
        return integer(name, check, optional=null != "never")
    if names_record:
        return record_name(name, optional=null != "never")
    return text(name, get_args(kind) if get_origin(kind) is Literal else (), optional=null != "never")


def _values(each: RecordField, value: Any) -> Row:
    count = len(_columns(each))
    if value is None:
        return (None,) * count
    if _is_record(each.type):
        return tuple(part for inner in fields_of(each.type) for part in _values(inner, getattr(value, inner.name)))
    row = tuple(value) if each.field.elements else (value,)
    if len(row) != count:
        message = f"{each.name} has {len(row)} values, not {count}"
        raise ValueError(message)
    return row


def _value(each: RecordField, values: Iterator[Any]) -> Any:
    """Take the value of a field from those of a row."""
    own = tuple(islice(values, len(_columns(each))))
    if each.optional and own[0] is None:
        return None
    if _is_record(each.type):
        inner_values = iter(own)
        return each.type(**{inner.name: _value(inner, inner_values) for inner in fields_of(each.type)})
    return own if each.field.elements else own[0]


def _is_record(kind: Any) -> bool:
    return isinstance(kind, type) and is_dataclass(kind)
