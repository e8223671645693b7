"""Definitions: records with a name, their columns and lists in a store, and the text that each came from."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import cache
from itertools import islice
from typing import Any, Generic, Literal, Protocol, TypeVar, cast, get_args, get_origin

from msgspec import Struct, StructMeta

from orip.errors import Complaint, InputError
from orip.files.stores.store import Row, Store
from orip.files.stores.table import (
    Null,
    StoreColumn,
    StoreTable,
    all_or_none,
    integer,
    list_table,
    position,
    real,
    record_name,
    text,
)
from orip.records.fields import RecordField, fields_by_column, fields_of, without_none
from orip.records.names import case_twins, record_key


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


class NamedRecord(Protocol):
    """A record of the model: all have a name."""

    @property
    def name(self) -> str:
        """Return the record's name; case does not count."""


T = TypeVar("T", bound=NamedRecord)
T_co = TypeVar("T_co", bound=NamedRecord, covariant=True)


class StoredRecord(Struct, Generic[T_co], frozen=True):
    """A definition as its store holds it.

    Parameters
    ----------
    record : a frozen structure of `orip.records`
    text_digest : str or None
        `record_digest` of the record in the text that this one came from; None if it came from no text.
    origin : str or None
        Name of the project that this text belongs to; cameras and temticks may be shared by projects.
    """

    record: T_co
    text_digest: str | None = None
    origin: str | None = None


class DefinitionTables(Struct, Generic[T], frozen=True):
    """How one kind of definition lies in its tables.

    Parameters
    ----------
    kind : type
        Dataclass of the records.
    table : StoreTable
        From `definition_table`.
    lists : mapping of str to StoreTable
        From `list_table`, by the field of the record.
    """

    kind: type[T]
    table: StoreTable
    lists: Mapping[str, StoreTable]

    @property
    def tables(self) -> tuple[StoreTable, ...]:
        """Return all tables."""
        return (self.table, *self.lists.values())

    def read(self, store: Store) -> tuple[StoredRecord[T], ...]:
        """Return all records in the order they were written; none if the store is absent."""
        fields = [record_field for record_field in fields_of(cast(type, self.kind)) if record_field.name in self.lists]
        lists = [(record_field, store.lists(self.lists[record_field.name])) for record_field in fields]
        stored = []
        for name, _position, digest, origin, *row in store.rows(self.table):
            values = {
                record_field.name: list_of(record_field, rows.get(record_key(name), [])) for record_field, rows in lists
            }
            record = self.kind(**values_of(self.kind, (name, *row)), **values)
            stored.append(StoredRecord(record, digest, origin))
        return tuple(stored)

    def write(self, store: Store, stored: Iterable[StoredRecord[T]]) -> None:
        """Replace all records."""
        everything = tuple(stored)
        refuse_case_twins(store, self.table.name, (item.record.name for item in everything))
        store.delete(self.table)
        for number, item in enumerate(everything):
            name, *row = row_of(item.record)
            store.insert(self.table, [(name, number, item.text_digest, item.origin, *row)])
            for field, table in self.lists.items():
                rows = list_rows(getattr(item.record, field) or ())
                store.insert(table, ((name, place, *values) for place, values in enumerate(rows)))


def definition_table(name: str, record: type) -> StoreTable:
    """Return the table of a kind of definition: name, order and text it came from, then the record's columns."""
    columns = (
        record_name("name"),
        position(),
        text("text_digest", optional=True),
        text("origin", optional=True),
        *columns_of(record)[1:],
    )
    return StoreTable(name, columns, key=("name",), checks=checks_of(record))


def record_list(name: str, owner: str, item: type) -> StoreTable:
    """Return the table of a list of records that each record of another table has; their names differ."""
    return list_table(name, owner, columns_of(item), "name")


def refuse_case_twins(store: Store, what: str, names: Iterable[str]) -> None:
    """Raise InputError if a name stands twice, or two names differ only in case."""
    listed = list(names)
    twice = [(name, name) for name, count in Counter(listed).items() if count > 1]
    pairs = [*twice, *case_twins(listed)]
    if pairs:
        rule = "are one name, since case does not count; rename one"
        raise InputError([Complaint(f"{what}: '{a}' and '{b}' {rule}", str(store.path)) for a, b in pairs])
