"""Measured marks (fiducials, ticks), and the orientations of photos and templates that consist of them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any, Generic, TypeVar, get_args

from msgspec import Struct

from orip.files.stores.contents.definitions import refuse_case_twins
from orip.files.stores.digest import record_digest
from orip.files.stores.store import Row, Store
from orip.files.stores.table import StoreTable, flag, list_table, real, text
from orip.records.measurement import (
    MeasuredMarks,
    PhotoOrientation,
    TemplateOrientation,
    TransformationKind,
)
from orip.records.names import record_key

Orientation = TypeVar("Orientation", bound=PhotoOrientation | TemplateOrientation)

TRANSFORMATION = text("transformation", get_args(TransformationKind))


def measured_marks_table(name: str, owner: str, parent: str) -> StoreTable:
    """Return the table of measured marks; their own given coordinates are NULL where a record has them."""
    columns = (text("name"), real("x"), real("y"), flag("disregarded"), real("given_x", "nan"), real("given_y", "nan"))
    return list_table(name, owner, columns, "name", parent=parent)


def measured_rows(marks: MeasuredMarks) -> list[Row]:
    """Return measured marks as rows."""
    import numpy as np

    coordinates = np.column_stack([marks.measured, marks.given]).tolist() if marks.names else []
    return [
        (name, x, y, bool(disregarded), given_x, given_y)
        for name, (x, y, given_x, given_y), disregarded in zip(marks.names, coordinates, marks.disregarded, strict=True)
    ]


def measured_of(rows: Sequence[Row]) -> MeasuredMarks:
    """Return rows as measured marks."""
    import numpy as np

    numbers = np.array([(x, y, given_x, given_y) for _name, x, y, _off, given_x, given_y in rows], dtype=np.float64)
    numbers = numbers.reshape(len(rows), 4)
    return MeasuredMarks(
        names=tuple(row[0] for row in rows),
        measured=numbers[:, :2].copy(),
        disregarded=np.array([row[3] for row in rows], dtype=np.bool_),
        given=numbers[:, 2:].copy(),
    )


def plain_marks(rows: Sequence[Row]) -> MeasuredMarks:
    """Return rows as `measured_of` does, with lists in place of arrays: what has the same digest."""
    measured: Any = [[x, y] for _name, x, y, *_ in rows]
    given: Any = [[x, y] for *_, x, y in rows]
    disregarded: Any = [row[3] for row in rows]
    return MeasuredMarks(tuple(row[0] for row in rows), measured, disregarded, given)


class OrientationTables(Struct, Generic[Orientation], frozen=True):
    """How orientations by marks lie in their tables; columns have the names of the record's fields, marks come last.

    Orientations refer to no definition: they are what replaying the measurements left, whatever is defined now.

    Parameters
    ----------
    table : StoreTable
        Its first column is the name of the photo or template.
    marks : StoreTable
        From `measured_marks_table`.
    """

    kind: Callable[..., Orientation]
    table: StoreTable
    marks: StoreTable

    @property
    def tables(self) -> tuple[StoreTable, ...]:
        """Return both tables."""
        return self.table, self.marks

    def read(self, store: Store) -> dict[str, Orientation]:
        """Return the orientations by the `record_key` of their photo or template, sorted by name."""
        marks = store.lists(self.marks)
        return {
            record_key(name): self.kind(name, *values, measured_of(marks.get(record_key(name), [])))
            for name, *values in store.rows(self.table)
        }

    def digests(self, store: Store) -> tuple[str, ...]:
        """Return the digests of the orientations, in the order in which they are read."""
        marks = store.lists(self.marks)
        return tuple(
            record_digest(self.kind(name, *values, plain_marks(marks.get(record_key(name), []))))
            for name, *values in store.rows(self.table)
        )

    def write(self, store: Store, orientations: Iterable[Orientation]) -> None:
        """Replace all orientations."""
        everything, columns = tuple(orientations), self.table.column_names
        names = [getattr(item, columns[0]) for item in everything]
        refuse_case_twins(store, self.table.name, names)
        store.delete(self.table)
        store.insert(self.table, (tuple(getattr(item, column) for column in columns) for item in everything))
        for name, item in zip(names, everything, strict=True):
            store.insert(self.marks, ((name, place, *row) for place, row in enumerate(measured_rows(item.marks))))
