"""Checksums of what a store holds: reading rows with a flipped bit raises an error that names them.

A sum goes over the values of a table, column by column, in the order in which they are read. Tables that are read
owner by owner have one for each owner. They are computed while rows are written or read; a store is
never read for its sums alone. They are of SHA-256, for which processors have instructions: with these it is more than
twice as fast as BLAKE2.
"""

from __future__ import annotations

import hashlib
import math
import sys
from array import array
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

from orip.files.stores.table import StoreColumn, StoreTable, integer, text
from orip.records.names import record_key

if TYPE_CHECKING:
    from numpy.typing import NDArray

CHECKSUM = StoreTable(
    "checksum", (text("of_table"), text("part"), integer("row_count"), text("sha256")), key=("of_table", "part")
)

_DIGITS = 32
"""Of a digest's 64: enough for what happens by chance."""

_NULL_TEXT = "\1"
_END = "\0"


class Sum(NamedTuple):
    """The checksum of a part of a table: the number of its rows, and a digest in hexadecimal digits."""

    rows: int
    digest: str


class RunningSum:
    """The checksum of rows that come some at a time."""

    def __init__(self, table: StoreTable) -> None:
        self._columns = table.in_file.columns
        self._hashes = [hashlib.sha256() for _ in self._columns]
        self._rows = 0

    def add(self, columns: Sequence[Sequence[Any] | NDArray[Any]]) -> None:
        """Add rows, given as their columns: plain values as SQLite takes or gives them, or arrays."""
        self._rows += len(columns[0])
        for column, running, values in zip(self._columns, self._hashes, columns, strict=True):
            for piece in _pieces_of(column, values):
                running.update(piece)

    def value(self) -> Sum | None:
        """Return the sum of all rows; None if there were none."""
        if not self._rows:
            return None
        digest = hashlib.sha256(b"".join(running.digest() for running in self._hashes))
        return Sum(self._rows, digest.hexdigest()[:_DIGITS])


class ContentSums:
    """The checksums of one store in a transaction: those that it has, and which are no longer those of its rows.

    Parameters
    ----------
    tables : sequence of StoreTable
        All of the store.
    known : mapping of (table, part) to Sum
        As the store has them.
    """

    def __init__(self, tables: Sequence[StoreTable], known: Mapping[tuple[str, str], Sum]) -> None:
        self.tables = tables
        self.known = dict(known)
        self.unsummed: set[tuple[str, str]] = set()
        """Parts that have changed and whose sums are not known yet."""
        self.is_changed = False

    def expected(self, table: StoreTable, owner: str | None) -> tuple[Sum | None, bool]:
        """Return the sum that rows should have, and whether that is known."""
        part = part_of(table, owner)
        is_known = owner is None or table.by_owner
        return self.known.get((table.name, part)), is_known and (table.name, part) not in self.unsummed

    def parts(self, table: StoreTable) -> set[str]:
        """Return the parts of a table that have sums."""
        return {part for name, part in self.known if name == table.name}

    def emptied(self, table: StoreTable, owner: str | None) -> None:
        """Forget the sums of what was deleted, and of the lists that go with it."""
        self.is_changed = True
        for gone in (table, *self._lists_of(table)):
            if owner is not None and not gone.by_owner:
                self.unsummed.add((gone.name, ""))
                continue
            for key in [key for key in {*self.known, *self.unsummed} if key[0] == gone.name]:
                if owner is None or key[1] == record_key(owner):
                    self.known.pop(key, None)
                    self.unsummed.discard(key)

    def filled(self, table: StoreTable, owner: str, running: RunningSum) -> None:
        """Take the sum of rows that were inserted, if these are all of their part."""
        key = (table.name, part_of(table, owner))
        total = running.value()
        if total is None:
            return
        if key in self.known or key in self.unsummed:
            self.inserted(table, owner)
        else:
            self.is_changed = True
            self.known[key] = total

    def inserted(self, table: StoreTable, owner: str) -> None:
        """Take note of a row that was inserted."""
        self.is_changed = True
        self.unsummed.add((table.name, part_of(table, owner)))

    def _lists_of(self, table: StoreTable) -> Iterable[StoreTable]:
        for other in self.tables:
            if other.parent == table.name:
                yield other
                yield from self._lists_of(other)


def part_of(table: StoreTable, owner: str | None) -> str:
    """Return the part of a table that the rows of an owner belong to."""
    return record_key(owner) if table.by_owner and owner is not None else ""


def _pieces_of(column: StoreColumn, values: Sequence[Any] | NDArray[Any]) -> Iterable[bytes]:
    if column.type == "BLOB":
        return (piece for value in values for piece in (len(value).to_bytes(8, "little"), value))
    return (_bytes_of(column, values),)


def _bytes_of(column: StoreColumn, values: Sequence[Any] | NDArray[Any]) -> bytes:
    if column.type == "TEXT":
        texts = [_NULL_TEXT if value is None else value for value in values] if column.null != "never" else values
        return (_END.join(texts) + _END).encode("utf-8", "surrogatepass")
    if column.type == "INTEGER" and column.null != "never":
        return _END.join(map(repr, values)).encode("ascii") + b"\0"
    if isinstance(values, tuple | list):
        return _bytes_of_numbers(column, values)
    import numpy as np  # rows of plain values do without

    if column.type == "INTEGER":
        return np.array(values, dtype="<i8").tobytes()
    numbers = np.array(values, dtype="<f8")
    numbers += 0.0  # SQLite keeps no negative zero
    unknown = np.isnan(numbers)
    if unknown.any():
        numbers[unknown] = np.nan  # nor does it keep which NaN it was
    return numbers.tobytes()


def _bytes_of_numbers(column: StoreColumn, values: Sequence[Any]) -> bytes:
    """Return the same bytes as of an array."""
    numbers: array[int] | array[float]
    if column.type == "INTEGER":
        numbers = array("q", map(int, values))
    else:
        numbers = array("d", (value + 0.0 if value is not None and value == value else math.nan for value in values))
    if sys.byteorder == "big":
        numbers.byteswap()
    return numbers.tobytes()
