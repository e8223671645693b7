"""One attached store inside a transaction: rows and columns go in and come out as plain values."""

from __future__ import annotations

import math
import sqlite3
from collections.abc import Iterable, Iterator, Sequence
from itertools import chain, groupby
from operator import itemgetter
from pathlib import Path
from typing import TYPE_CHECKING, Any

from msgspec import Struct

from orip.errors import InputError
from orip.files.stores.checksum import CHECKSUM, ContentSums, RunningSum, Sum, part_of
from orip.files.stores.table import StoreColumn, StoreTable, quoted
from orip.records.names import record_key

if TYPE_CHECKING:
    from orip.files.stores.packed_columns import ColumnValues

Row = tuple[Any, ...]

PYTHON_TYPES = {"TEXT": str, "INTEGER": int, "REAL": float, "BLOB": bytes}
NOTHING = "SELECT 1 WHERE 0"
ROWS_AT_A_TIME = 50_000
"""Rows that go at once from arrays and into them: enough to be fast, too few for millions of Python floats."""

CELLS_OF_PART = 10 << 20
"""Values of a packed list, in all its columns, in one row of the file: SQLite copies a row as a whole, and has none of
more than a gigabyte."""

_CELLS_OF_THREAD = 1 << 16
"""Values of a packed list that take a thread some milliseconds."""


def damage(path: Path, finding: str) -> InputError:
    """Return the error for a store whose content cannot be what orip wrote."""
    return InputError.single(
        f"the store is damaged ({finding}); a store is whole or absent: move it away and load its last dump, "
        f"or create a new one with 'orip init' and 'orip measure'",
        str(path),
    )


class Store(Struct, frozen=True):
    """A store that takes part in the current transaction.

    Parameters
    ----------
    path : Path
        As the caller named it.
    kind : str
        'CAM', 'TIK', 'PHO', 'TEM', 'EXT' or 'EXO'.
    schema : str
        Name under which the file is attached.
    present : bool
        False where there is no file yet: all tables are empty.
    sums : ContentSums or None
        What is read is held against them, what is written changes them; None: neither, as in a private database.
    """

    path: Path
    kind: str
    connection: sqlite3.Connection
    schema: str
    present: bool
    sums: ContentSums | None = None

    def insert(self, table: StoreTable, rows: Iterable[Sequence[Any]]) -> None:
        """Insert rows of single values; NaN becomes NULL. Rows of a packed list come owner by owner, in their order."""
        if table.packed:
            for _owner, of_owner in groupby(rows, itemgetter(0)):
                self.insert_columns(table, *zip(*of_owner, strict=True))
            return
        self._insert(table, self._noted(table, (tuple(map(_plain, row)) for row in rows)))

    def insert_columns(self, table: StoreTable, *columns: ColumnValues) -> None:
        """Insert many rows given as one array or tuple per column, all of one length.

        They come in reading order, and of a table that is read by owner all are of one owner.
        """
        running = RunningSum(table)
        for part in self._packed(table, columns) if table.packed else (columns,):
            self._insert(table, _rows_of(part))
            if self.sums is not None:
                running.add(part)
            del part  # before the next one is packed
        if self.sums is not None and len(columns[0]):
            self.sums.filled(table, columns[0][0], running)

    def delete(self, table: StoreTable, owner: str | None = None) -> None:
        """Delete all rows, or those whose first column is `owner`."""
        of_owner = owner is not None
        self.connection.execute(table.delete(self.schema, of_owner=of_owner), (owner,) if of_owner else ())
        if self.sums is not None:
            self.sums.emptied(table, owner)

    def rows(self, table: StoreTable, owner: str | None = None) -> Iterator[Row]:
        """Yield rows in reading order with NULL as None or NaN; those whose first column is `owner`, or all."""
        if table.packed:
            yield from zip(*map(_plain_values, self.columns(table, owner)), strict=True)
            return
        rows = list(self._checked(table, self._cursor(table, owner)))
        running = RunningSum(table)
        if rows:
            running.add(list(zip(*rows, strict=True)))
        self._require_sum(table, owner, running.value())
        for row in rows:
            yield tuple(map(_read, table.columns, row))

    def stored_rows(self, table: StoreTable) -> Iterator[Row]:
        """Yield all rows sorted by primary key as SQLite holds them: NaN as None, flags as 0 and 1."""
        if table.packed:
            rows = (zip(*map(_plain_values, columns), strict=True) for columns in self._unpacked(table, None))
            yield from (tuple(map(_stored, row)) for row in chain.from_iterable(rows))
            return
        cursor = self.connection.execute(table.select(self.schema, order=table.key) if self.present else NOTHING)
        yield from self._checked(table, cursor)

    def columns(self, table: StoreTable, owner: str | None = None) -> tuple[ColumnValues, ...]:
        """Return the columns in reading order: float64, int64 and bool arrays, tuples of str."""
        from orip.files.stores.packed_columns import column_values, joined_column

        if table.packed:
            chunks: list[list[ColumnValues]] = [[] for _ in table.columns]
            for of_row in self._unpacked(table, owner):
                for values, parts in zip(of_row, chunks, strict=True):
                    parts.append(values)
            # the parts of a column go as soon as it is whole
            return tuple(joined_column(column, chunks.pop(0)) for column in table.columns)
        chunks = [[] for _ in table.columns]
        # A block has far more observations than names: each name is kept once, not once a row.
        known: dict[str, str] = {}
        running = RunningSum(table)
        cursor = self._cursor(table, owner)
        while rows := cursor.fetchmany(ROWS_AT_A_TIME):
            for column, values, parts in zip(table.columns, zip(*rows, strict=True), chunks, strict=True):
                try:
                    parts.append(column_values(column, values, known))
                except (TypeError, ValueError, OverflowError) as error:
                    raise damage(self.path, f"table {table.name}, column {column.name}: {error}") from error
            running.add([parts[-1] for parts in chunks])
        self._require_sum(table, owner, running.value())
        return tuple(joined_column(column, parts) for column, parts in zip(table.columns, chunks, strict=True))

    def holds(self, table: StoreTable, owner: str, columns: Sequence[ColumnValues]) -> bool:
        """Tell whether a packed list of an owner has these columns, without owner and position.

        No more of it is read at once than a column of one row of the file.

        Raises
        ------
        InputError
            If the store is damaged.
        """
        from orip.files.stores.packed_columns import part_of_column, same_column

        self._require_sum(table, owner, self._sum_of(table, owner))
        length, place = len(columns[0]), 0
        for _name, first, count, *blobs in self._cursor(table, owner):
            is_whole = count == length
            for column, blob, values in zip(table.packed_columns, blobs, columns, strict=True):
                wanted = values if is_whole else part_of_column(values, first, count)
                if first != place or not same_column(self._unpacked_column(table, column, blob, count), wanted):
                    return False
            place += count
        return place == length

    def lists(self, table: StoreTable) -> dict[str, list[Row]]:
        """Return the items of a list table, without owner and position, by the `record_key` of their owner."""
        items: dict[str, list[Row]] = {}
        for owner, _position, *values in self.rows(table):
            items.setdefault(record_key(owner), []).append(tuple(values))
        return items

    def spelling(self, table: StoreTable, name: str) -> str | None:
        """Return the name in the table's first column that is `name` when case is ignored."""
        # NOCASE knows the letters of ASCII only; record names may have others.
        return next((row[0] for row in self.rows(table) if record_key(row[0]) == record_key(name)), None)

    def verify(self) -> None:
        """Read all rows, and hold them against their checksums.

        Raises
        ------
        InputError
            If the store is damaged.
        """
        if self.sums is None:
            return
        for table in self.sums.tables:
            owners = self._owners(table)
            for owner in owners:
                self._require_sum(table, owner, self._sum_of(table, owner))
            gone = self.sums.parts(table) - {part_of(table, owner) for owner in owners}
            if gone:
                raise damage(self.path, f"table {table.name}: the rows of {min(gone)} are missing")

    def seal(self) -> None:
        """Write the checksums of what has changed; the last thing that a transaction does."""
        sums = self.sums
        if sums is None or not sums.is_changed:
            return
        for table in sums.tables:
            parts = {part for name, part in sums.unsummed if name == table.name}
            for owner in self._owners(table) if parts else ():
                part = part_of(table, owner)
                if part in parts:
                    total = self._sum_of(table, owner)
                    sums.known.pop((table.name, part), None)
                    sums.known |= {} if total is None else {(table.name, part): total}
        rows = [(*key, *total) for key, total in sorted(sums.known.items())]
        self.connection.execute(CHECKSUM.delete(self.schema))
        self.connection.executemany(CHECKSUM.insert(self.schema), rows)

    def _owners(self, table: StoreTable) -> list[str | None]:
        """Return the owners whose rows have checksums of their own, None for those of a whole table."""
        if not table.by_owner:
            return [None]
        owner = quoted(table.columns[0].name)
        query = f"SELECT DISTINCT {owner} FROM {self.schema}.{quoted(table.name)} ORDER BY 1"
        owners = [row[0] for row in self.connection.execute(query)]
        if not all(isinstance(owner, str) for owner in owners):
            raise damage(self.path, f"table {table.name}: a name is no text")
        return list[str | None](owners)

    def _sum_of(self, table: StoreTable, owner: str | None) -> Sum | None:
        running = RunningSum(table)
        cursor = self._cursor(table, owner)
        while rows := cursor.fetchmany(1 if table.packed else ROWS_AT_A_TIME):
            # a damaged file may have other types than its schema, which would not be worth a look at each value
            try:
                running.add(list(zip(*rows, strict=True)))
            except (TypeError, ValueError, OverflowError, AttributeError) as error:
                raise damage(self.path, f"table {table.name}: {error}") from error
        return running.value()

    def _require_sum(self, table: StoreTable, owner: str | None, found: Sum | None) -> None:
        if self.sums is None or not self.present:
            return
        expected, is_known = self.sums.expected(table, owner)
        if is_known and found != expected:
            of_owner = f" of {owner}" if owner is not None else ""
            raise damage(self.path, f"table {table.name}{of_owner}: its content is not what orip wrote")

    def _noted(self, table: StoreTable, rows: Iterable[Row]) -> Iterator[Row]:
        for row in rows:
            if self.sums is not None:
                self.sums.inserted(table, row[0])
            yield row

    def _insert(self, table: StoreTable, rows: Iterable[Row]) -> None:
        try:
            self.connection.executemany(table.in_file.insert(self.schema), rows)
        except UnicodeEncodeError as error:
            raise self._not_text(error) from error

    def _checked(self, table: StoreTable, rows: Iterable[Row]) -> Iterator[Row]:
        for row in rows:
            fault = next(filter(None, map(stored_fault, table.columns, row)), None)
            if fault is not None:
                raise damage(self.path, f"table {table.name}, {fault}")
            yield row

    def _cursor(self, table: StoreTable, owner: str | None) -> sqlite3.Cursor:
        if not self.present:
            return self.connection.execute(NOTHING)
        of_owner = owner is not None
        select = table.in_file.select(self.schema, of_owner=of_owner)
        return self.connection.execute(select, (owner,) if of_owner else ())

    def _packed(self, table: StoreTable, columns: Sequence[ColumnValues]) -> Iterator[tuple[ColumnValues, ...]]:
        """Yield the columns of each row that the file has of a packed list."""
        from orip.files.stores.packed_columns import packed_column, part_of_column
        from orip.threads import by_threads

        owner, _position, *rest = columns
        if len({len(column) for column in columns}) > 1:
            message = f"table {table.name}: a column is shorter than another one"
            raise ValueError(message)
        most = max(CELLS_OF_PART // len(table.packed_columns), 1)
        for first in range(0, len(owner), most):
            # a list in one row keeps all its names, in the order in which the points of a block are known
            parts = rest if len(owner) <= most else [part_of_column(values, first, most) for values in rest]
            given, pays = zip(table.packed_columns, parts, strict=True), 1 + _CELLS_OF_THREAD // max(len(parts[0]), 1)
            try:
                packed = by_threads(lambda of_column: packed_column(*of_column), given, pays)
            except UnicodeEncodeError as error:
                raise self._not_text(error) from error
            yield (owner[0],), (first,), (len(parts[0]),), *((column,) for column in packed)

    def packed_rows(self, table: StoreTable, owner: str | None = None) -> Iterator[Row]:
        """Yield each row that the file has of a packed list: owner, first position, number, and a BLOB a column."""
        if owner is not None or not table.by_owner:
            self._require_sum(table, owner, self._sum_of(table, owner))
        yield from self._checked(table.in_file, self._cursor(table, owner))

    def _unpacked(self, table: StoreTable, owner: str | None) -> Iterator[tuple[ColumnValues, ...]]:
        """Yield the columns of each row that the file has of a packed list, of one owner or of all."""
        from orip.files.stores.packed_columns import positions
        from orip.records.coded_names import repeated

        for name, first, count, *blobs in self.packed_rows(table, owner):
            columns = zip(table.packed_columns, blobs, strict=True)
            values = [self._unpacked_column(table, column, blob, count) for column, blob in columns]
            yield (repeated(name, count), positions(first, count), *values)

    def _unpacked_column(self, table: StoreTable, column: StoreColumn, blob: bytes, count: int) -> ColumnValues:
        from orip.files.stores.packed_columns import unpacked_values

        try:
            return unpacked_values(column, blob, count)
        except (ValueError, OverflowError, MemoryError) as error:
            raise damage(self.path, f"table {table.name}, column {column.name}: {error}") from error

    def _not_text(self, error: UnicodeEncodeError) -> InputError:
        message = f"the text {error.object!a} has characters that no file of text can hold; write it differently"
        return InputError.single(message, str(self.path))


def _rows_of(columns: Sequence[ColumnValues]) -> Iterator[Row]:
    """Yield rows of plain values from columns of one length, some thousands of them as Python objects at a time."""
    for start in range(0, max(map(len, columns)), ROWS_AT_A_TIME):
        part = slice(start, start + ROWS_AT_A_TIME)
        yield from zip(*(_plain_values(column[part]) for column in columns), strict=True)


def _plain_values(values: ColumnValues) -> Sequence[Any]:
    return values.tolist() if hasattr(values, "tolist") else values  # an array


def _stored(value: Any) -> Any:
    """Return a value as SQLite would hold it: NaN as None, flags as 0 and 1."""
    if isinstance(value, bool):
        return int(value)
    return None if value != value else value


def _plain(value: Any) -> Any:
    """Return a NumPy scalar as the Python value that sqlite3 can bind."""
    return value.item() if hasattr(value, "item") else value


def stored_fault(column: StoreColumn, value: Any) -> str | None:
    """Say why SQLite should not hold this value in a column, or return None if it may."""
    if value is None:
        return None if column.null != "never" else f"column {column.name}: null, but a value is needed"
    if type(value) is not PYTHON_TYPES[column.type]:
        return f"column {column.name}: {value!r} is no {column.type}"
    if isinstance(value, float) and math.isinf(value) and not column.infinite:
        return f"column {column.name}: infinite, but a finite number is needed"
    return None


def _read(column: StoreColumn, value: Any) -> Any:
    if value is None:
        return math.nan if column.null == "nan" else None
    return bool(value) if column.flag else value
