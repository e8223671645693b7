"""Definitions: records with a name, their lists, and the text that each came from."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Generic, Protocol, TypeVar

from orip.errors import Complaint, InputError
from orip.files.stores.store import Row, Store
from orip.files.stores.table import Column, Table, position, record_name, text
from orip.records.names import case_twins, record_key


class Named(Protocol):
    """A record of the model: all have a name."""

    @property
    def name(self) -> str:
        """Return the record's name; case does not count."""


T = TypeVar("T", bound=Named)
T_co = TypeVar("T_co", bound=Named, covariant=True)


@dataclass(frozen=True, slots=True)
class StoredRecord(Generic[T_co]):
    """A definition as its store holds it.

    Parameters
    ----------
    record : a frozen dataclass of `orip.records`
    text_digest : str or None
        `record_digest` of the record in the text that this one came from; None if it came from no text.
    origin : str or None
        Name of the project that this text belongs to; cameras and temticks may be shared by projects.
    """

    record: T_co
    text_digest: str | None = None
    origin: str | None = None


@dataclass(frozen=True, slots=True)
class Parts:
    """A definition taken apart: the values of its own columns, and the rows of each of its lists."""

    values: Row
    lists: tuple[Sequence[Row], ...] = ()


@dataclass(frozen=True, slots=True)
class Definitions(Generic[T]):
    """How one kind of definition lies in its tables.

    Parameters
    ----------
    table : Table
        From `definition_table`.
    lists : tuple of Table
        From `list_table`, in the order of `Parts.lists`.
    apart : function of a record that returns its Parts
    together : function of a name and Parts that returns the record
    """

    table: Table
    lists: tuple[Table, ...]
    apart: Callable[[T], Parts]
    together: Callable[[str, Parts], T]

    def read(self, store: Store) -> tuple[StoredRecord[T], ...]:
        """Return all records in the order they were written; none if the store is absent."""
        lists = [store.lists(table) for table in self.lists]
        stored = []
        for name, _position, digest, origin, *values in store.rows(self.table):
            parts = Parts(tuple(values), tuple(items.get(record_key(name), []) for items in lists))
            stored.append(StoredRecord(self.together(name, parts), digest, origin))
        return tuple(stored)

    def write(self, store: Store, stored: Iterable[StoredRecord[T]]) -> None:
        """Replace all records."""
        everything = tuple(stored)
        refuse_case_twins(store, self.table.name, (item.record.name for item in everything))
        store.delete(self.table)
        for number, item in enumerate(everything):
            name, parts = item.record.name, self.apart(item.record)
            store.insert(self.table, [(name, number, item.text_digest, item.origin, *parts.values)])
            for table, rows in zip(self.lists, parts.lists, strict=True):
                store.insert(table, ((name, place, *row) for place, row in enumerate(rows)))


def definition_table(name: str, columns: Sequence[Column], checks: Sequence[str] = ()) -> Table:
    """Return the table of a kind of definition: name, order and text it came from, then the record's columns."""
    leading = (
        record_name("name"),
        position(),
        text("text_digest", optional=True),
        text("origin", optional=True),
    )
    return Table(name, (*leading, *columns), key=("name",), checks=tuple(checks))


def refuse_case_twins(store: Store, what: str, names: Iterable[str]) -> None:
    """Raise InputError if a name stands twice, or two names differ in case alone."""
    listed = list(names)
    twice = [(name, name) for name, count in Counter(listed).items() if count > 1]
    pairs = [*twice, *case_twins(listed)]
    if pairs:
        rule = "are one name, since case does not count; rename one"
        raise InputError([Complaint(f"{what}: '{a}' and '{b}' {rule}", str(store.path)) for a, b in pairs])
