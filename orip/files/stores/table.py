"""The tables of a record store as data: what creates, fills, dumps and loads them."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import Literal

from msgspec import Struct

from orip.structs import replace

ColumnType = Literal["TEXT", "INTEGER", "REAL", "BLOB"]
Null = Literal["never", "none", "nan"]
"""What NULL stands for: it is refused, it is None, or it is NaN (which SQLite cannot hold)."""

FIRST_ROW, ROW_COUNT = "first_row", "row_count"
"""Columns of a packed list: the position of the first of the rows packed together, and how many they are."""


class StoreColumn(Struct, frozen=True):
    """One column of a table.

    Parameters
    ----------
    type : {"TEXT", "INTEGER", "REAL", "BLOB"}
    null : {"never", "none", "nan"}
    check : str
        SQL condition that every value meets.
    record_name : bool
        The name of a record: one word, compared without regard to case.
    flag : bool
        An INTEGER 0 or 1 that is read as bool.
    infinite : bool
        A REAL that may be infinite: a figure that an adjustment gave, nothing that one begins with.
    """

    name: str
    type: ColumnType
    null: Null = "never"
    check: str = ""
    record_name: bool = False
    flag: bool = False
    infinite: bool = False

    @property
    def ddl(self) -> str:
        """Return the column's definition for CREATE TABLE."""
        parts = [
            quoted(self.name),
            self.type,
            "COLLATE NOCASE" if self.record_name else "",
            "NOT NULL" if self.null == "never" else "",
            _check(self.check) if self.check else "",
        ]
        return " ".join(filter(None, parts))


def text(name: str, choices: Sequence[str] = (), *, optional: bool = False) -> StoreColumn:
    """Return a column of text; `optional` text may be None."""
    check = f"{quoted(name)} IN ({', '.join(map(_literal, choices))})" if choices else ""
    return StoreColumn(name, "TEXT", "none" if optional else "never", check)


def record_name(name: str, *, optional: bool = False) -> StoreColumn:
    """Return a column of names of records."""
    return StoreColumn(name, "TEXT", "none" if optional else "never", record_name=True)


def integer(name: str, check: str = "", *, optional: bool = False) -> StoreColumn:
    """Return a column of whole numbers."""
    return StoreColumn(name, "INTEGER", "none" if optional else "never", check)


def flag(name: str) -> StoreColumn:
    """Return a column of yes or no."""
    return StoreColumn(name, "INTEGER", check=f"{quoted(name)} IN (0, 1)", flag=True)


def real(name: str, null: Null = "never", check: str = "") -> StoreColumn:
    """Return a column of finite floating point numbers."""
    return StoreColumn(name, "REAL", null, check)


def figure(name: str) -> StoreColumn:
    """Return a column of figures of an adjustment: any floating point number, NaN and infinity too."""
    return StoreColumn(name, "REAL", "nan", infinite=True)


def position() -> StoreColumn:
    """Return the column that keeps the order of a list."""
    return integer("position", '"position" >= 0')


class StoreTable(Struct, frozen=True):
    """One table of a store.

    Parameters
    ----------
    key : tuple of str
        Columns of the primary key.
    parent : str
        Table whose primary key the first column names; a row goes when its parent goes.
    unique : tuple of tuples of str
        Further columns that together are different in every row.
    checks : tuple of str
        SQL conditions that every row meets.
    by_owner : bool
        Rows are read owner by owner: those of each have a checksum of their own.
    packed : bool
        A list that may have millions of rows: in the file many of an owner's are one, with a column's values in a BLOB.
    """

    name: str
    columns: tuple[StoreColumn, ...]
    key: tuple[str, ...]
    parent: str = ""
    unique: tuple[tuple[str, ...], ...] = ()
    checks: tuple[str, ...] = ()
    by_owner: bool = False
    packed: bool = False

    @property
    def in_file(self) -> StoreTable:
        """Return the table as the file has it: of a packed list its owners, which rows, and packed columns."""
        if not self.packed:
            return self
        owner, *_ = self.columns
        blobs = (StoreColumn(column.name, "BLOB") for column in self.packed_columns)
        first = integer(FIRST_ROW, f"{quoted(FIRST_ROW)} >= 0")
        columns = (owner, first, integer(ROW_COUNT, f"{quoted(ROW_COUNT)} > 0"), *blobs)
        return replace(self, columns=columns, key=(owner.name, FIRST_ROW), unique=(), checks=(), packed=False)

    @property
    def packed_columns(self) -> tuple[StoreColumn, ...]:
        """Return the columns of a packed list that the file has as BLOBs: owner and position follow from the rest."""
        return self.columns[2:]

    @property
    def column_names(self) -> tuple[str, ...]:
        """Return the names of the columns in order."""
        return tuple(column.name for column in self.columns)

    @property
    def reading_order(self) -> tuple[str, ...]:
        """Return the columns to sort by so that lists come back in their order."""
        outside_key = "position" in self.column_names and "position" not in self.key
        return ("position", *self.key) if outside_key else self.key

    def ddl(self, schema: str) -> str:
        """Return the CREATE TABLE statement for one attached store."""
        owner = f"FOREIGN KEY ({quoted(self.columns[0].name)}) REFERENCES {quoted(self.parent)}"
        parts = [
            *(column.ddl for column in self.columns),
            f"PRIMARY KEY ({_list(self.key)})",
            *(f"UNIQUE ({_list(columns)})" for columns in self.unique),
            *([f"{owner} ON DELETE CASCADE ON UPDATE CASCADE"] if self.parent else []),
            *map(_check, self.checks),
        ]
        # Without rowid the owner's name is stored once a row, not twice: large solutions are a third smaller.
        return f"CREATE TABLE {schema}.{quoted(self.name)} ({', '.join(parts)}) STRICT, WITHOUT ROWID"

    def insert(self, schema: str) -> str:
        """Return the INSERT statement with a parameter for each column."""
        marks = ", ".join("?" * len(self.columns))
        return f"INSERT INTO {schema}.{quoted(self.name)} VALUES ({marks})"

    def select(self, schema: str, *, of_owner: bool = False, order: Sequence[str] = ()) -> str:
        """Return the SELECT statement of all columns; with a parameter for the first column if `of_owner`."""
        where = f" WHERE {quoted(self.columns[0].name)} = ?" if of_owner else ""
        return (
            f"SELECT {_list(self.column_names)} FROM {schema}.{quoted(self.name)}{where} "
            f"ORDER BY {_list(order or self.reading_order)}"
        )

    def delete(self, schema: str, *, of_owner: bool = False) -> str:
        """Return the DELETE statement; with a parameter for the first column if `of_owner`."""
        where = f" WHERE {quoted(self.columns[0].name)} = ?" if of_owner else ""
        return f"DELETE FROM {schema}.{quoted(self.name)}{where}"


def list_table(
    name: str,
    owner: str,
    columns: Sequence[StoreColumn],
    *unique: str,
    parent: str = "",
    by_owner: bool = False,
    packed: bool = False,
) -> StoreTable:
    """Return the table of a list that each record of another table has: owner, position, then the items' columns.

    The owner's column is called `owner`, and so is its table unless `parent` says otherwise. Items of one owner differ
    in the `unique` column, if one is given; `by_owner` and `packed` are those of the table.
    """
    return StoreTable(
        name,
        (record_name(owner), position(), *columns),
        key=(owner, "position"),
        parent=parent or owner,
        unique=tuple((owner, column) for column in unique),
        by_owner=by_owner,
        packed=packed,
    )


def all_or_none(*names: str) -> str:
    """Return the condition that the columns are either all known or all NULL."""
    nulls = " + ".join(f"({quoted(name)} IS NULL)" for name in names)
    return f"{nulls} IN (0, {len(names)})"


@cache
def quoted(name: str) -> str:
    """Return a name of the schema as an SQL identifier."""
    return '"' + name.replace('"', '""') + '"'


def _list(names: Sequence[str]) -> str:
    return ", ".join(map(quoted, names))


def _check(condition: str) -> str:
    # Doubled parentheses: of a broken rule that starts with '"', SQLite's message has the first word only.
    return f"CHECK (({condition}))"


def _literal(value: str) -> str:
    return "'" + value.replace("'", "''") + "'"
