"""Definitions: records with a name, their lists, and the text that each came from."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from typing import Generic, Protocol, TypeVar, cast

from msgspec import Struct

from orip.errors import Complaint, InputError
from orip.files.stores.contents.record_columns import checks_of, columns_of, list_of, list_rows, row_of, values_of
from orip.files.stores.store import Store
from orip.files.stores.table import StoreTable, list_table, position, record_name, text
from orip.records.fields import fields_of
from orip.records.names import case_twins, record_key


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
