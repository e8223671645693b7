"""A store as canonical text and back: equal data give equal text, checked as a whole before it replaces a store."""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Iterable, Iterator
from contextlib import closing, suppress
from pathlib import Path
from typing import Any

from msgspec import Struct, field

from orip.errors import Complaint, InputError
from orip.files.stores.contents.stores import require_names_of_bundles
from orip.files.stores.digest import META, run_of, set_run
from orip.files.stores.identity import DUMP_VERSION, create, kind_of, summed_tables
from orip.files.stores.store import Store, stored_fault
from orip.files.stores.store_files import explained
from orip.files.stores.table import StoreColumn, StoreTable
from orip.files.stores.transaction import connected, reading, writing
from orip.files.text.shown import printable
from orip.records.names import name_fault, record_key
from orip.structs import replace

# A dump is one JSON value a line: a header, then for each table a line that names it and its columns, and its rows
# sorted by primary key, and at last a line that tells that nothing is missing::
#
#     {"format": "orip.dump/1", "kind": "TIK", "schema": 1, "run": null}
#     {"table": "temtick", "columns": ["name", "position", "text_digest", "origin"]}
#     ["RESEAU", 0, null, null]
#     {"end": "TIK"}
#
# Numbers are written with as few digits as give the same double back; infinity is ``Infinity``, NaN is ``null``.

FORMAT = "orip.dump/1"
# JSON leaves these characters as they are, but many programs end a line there.
LINE_ENDS = str.maketrans({mark: f"\\u{ord(mark):04x}" for mark in "\x7f\x85\u2028\u2029"})


def dump(path: Path) -> Iterator[str]:
    """Yield the lines of a store's dump, without line ends; an absent store has no rows.

    Raises
    ------
    InputError
        If the file is no store of its kind, of another version or damaged; before the first line.
    """
    with reading([path]) as stores:
        store = stores[path]
        if store.present:
            with explained([path]):
                store.verify()
        yield _line({"format": FORMAT, "kind": store.kind, "schema": DUMP_VERSION, "run": run_of(store)})
        yield from _body(store)


def dumped_tables(kind: str) -> tuple[StoreTable, ...]:
    """Return the tables of a dump in their order; the contents of `meta` are in the header."""
    return tuple(table for table in summed_tables(kind) if table is not META)


def _body(store: Store) -> Iterator[str]:
    with explained([store.path]):
        for table in dumped_tables(store.kind):
            yield _line({"table": table.name, "columns": table.column_names})
            for row in store.stored_rows(table):
                yield _line(row)
        yield _line({"end": store.kind})


def _line(value: Any) -> str:
    return json.dumps(value, ensure_ascii=False).translate(LINE_ENDS)


MOST_COMPLAINTS = 100
INTEGERS = range(-(2**63), 2**63)


def read_dump(lines: Iterable[str], store: Store, source: str) -> str | None:
    """Insert the rows of a dump into an empty store and return the run id of its header.

    Raises
    ------
    InputError
        With a complaint for every fault; the store is then of no use.
    """
    reader = _Reader(store, _Complaints(source))
    with suppress(_StopReadingError):
        reader.read(lines)
    if reader.complaints.found:
        raise InputError(reader.complaints.found)
    return reader.run


class _StopReadingError(Exception):
    """What follows in the text cannot be judged."""


class _Complaints(Struct):
    source: str
    found: list[Complaint] = field(default_factory=list)

    def add(self, line: int, message: str, column: int | None = None) -> None:
        self.found.append(Complaint(printable(message), self.source, line, column))
        if len(self.found) == MOST_COMPLAINTS:
            self.stop(line, "too many faults; the rest was not read")

    def stop(self, line: int, message: str) -> None:
        self.found.append(Complaint(printable(message), self.source, line))
        raise _StopReadingError


class _Reader(Struct):
    """Where the reading of a dump stands.

    `due` are the tables that have not begun, `names` the record names seen in `table`, and `refused` the rows with a
    fault, whose lists are then not complained of.
    """

    store: Store
    complaints: _Complaints
    run: str | None = None
    table: StoreTable | None = None
    due: list[StoreTable] = field(default_factory=list)
    names: dict[str, str] = field(default_factory=dict)
    refused: set[tuple[str, str]] = field(default_factory=set)

    def read(self, lines: Iterable[str]) -> None:
        values = self._values(lines)
        number, header = next(values, (1, None))
        self._take_header(number, header)
        self.due = list(dumped_tables(self.store.kind))
        for number, value in values:
            if isinstance(value, list):
                self._take_row(number, value)
            elif value == {"end": self.store.kind} and not self.due:
                self._expect_nothing_more(values)
                return
            else:
                self._take_table(number, value)
        missing = f"table '{self.due[0].name}' is due" if self.due else f'{{"end": "{self.store.kind}"}} is due'
        self.complaints.stop(number, f"the text ends early: {missing}; make the dump again")

    def _values(self, lines: Iterable[str]) -> Iterator[tuple[int, Any]]:
        for number, line in enumerate(lines, start=1):
            if not line.strip():
                continue
            try:
                value = json.loads(line)
            except json.JSONDecodeError as error:
                self.complaints.add(number, f"{error.msg}; a dump has one JSON value a line", error.colno)
            except (RecursionError, ValueError) as error:
                self.complaints.add(number, f"{error}; a dump has one JSON value a line")
            else:
                yield number, value

    def _take_header(self, line: int, header: object) -> None:
        if not isinstance(header, dict) or header.get("format") != FORMAT:
            self.complaints.stop(line, f'this is not a dump of a store: the first line has no "format": "{FORMAT}"')
            return
        kind, schema, self.run = header.get("kind"), header.get("schema"), header.get("run")
        if kind != self.store.kind:
            self.complaints.stop(line, f"this is a dump of a .{kind}; load it as such, '{self.store.path}' is none")
        if schema != DUMP_VERSION or isinstance(schema, bool):
            known = f"this orip knows schema {DUMP_VERSION}"
            self.complaints.stop(line, f"this dump has schema {schema!r}, {known}; load it with the orip that made it")
        if not isinstance(self.run, str | None):
            self.complaints.add(line, f"the run {self.run!r} is neither text nor null")

    def _take_table(self, line: int, value: object) -> None:
        table = self.due.pop(0) if self.due else None
        expected = {"table": table.name, "columns": list(table.column_names)} if table else {"end": self.store.kind}
        if value != expected:
            self.complaints.stop(line, f"expected {json.dumps(expected)}, found {_short(value)}")
        self.table, self.names = table, {}

    def _expect_nothing_more(self, values: Iterator[tuple[int, Any]]) -> None:
        for line, _value in values:
            self.complaints.stop(line, "the dump ended before this line; remove the rest")

    def _take_row(self, line: int, row: list[Any]) -> None:
        if self.table is None:
            self.complaints.stop(line, "a row before any table")
            return
        if len(row) != len(self.table.columns):
            faults = [f"{len(row)} values, {len(self.table.columns)} are needed"]
        else:
            row = [_as_float(column, value) for column, value in zip(self.table.columns, row, strict=True)]
            faults = [fault for fault in map(_fault, self.table.columns, row) if fault]
            faults = faults or self._faults_of_insertion(self.table, row)
        if faults:
            self.refused.add((self.table.name, record_key(str(row[0])) if row else ""))
        for fault in faults:
            self.complaints.add(line, f"table {self.table.name}: {fault}")

    def _faults_of_insertion(self, table: StoreTable, row: list[Any]) -> list[str]:
        if table.columns[0].record_name:
            owner = record_key(row[0])
            if table.parent and (table.parent, owner) in self.refused:
                return []
            if table.key == (table.columns[0].name,) and self.names.setdefault(owner, row[0]) != row[0]:
                return [f"'{row[0]}' and '{self.names[owner]}' are one name, since case does not count; rename one"]
        try:
            self.store.connection.execute(table.insert(self.store.schema), row)
        except sqlite3.IntegrityError as error:
            return [_rule_broken(table, row, str(error))]
        return []


def _as_float(column: StoreColumn, value: Any) -> Any:
    """Return a whole number that stands for a float as float; anything else as it is."""
    if column.type == "REAL" and type(value) is int and abs(value) < 2**1000:
        return float(value)
    return value


def _fault(column: StoreColumn, value: Any) -> str | None:
    fault = stored_fault(column, value)
    if fault or value is None:
        return fault
    if column.type == "INTEGER" and value not in INTEGERS:
        return f"column {column.name}: {value} has more than 64 bits"
    if column.type == "REAL" and value != value:
        allowed = "write null" if column.null == "nan" else "a number is needed"
        return f"column {column.name}: NaN is not allowed; {allowed}"
    if column.type == "TEXT" and not _is_unicode(value):
        return f"column {column.name}: {value!a} has half a surrogate pair, which is not a character"
    if column.record_name and (fault := name_fault(value)):
        return f"column {column.name}: {fault}"
    return None


def _is_unicode(value: str) -> bool:
    try:
        value.encode()
    except UnicodeEncodeError:
        return False
    return True


def _rule_broken(table: StoreTable, row: list[Any], error: str) -> str:
    rule, _, what = error.partition(": ")
    if rule.startswith("FOREIGN KEY"):
        return f"table {table.parent} has no '{row[0]}'; add it there or remove this row"
    if rule.startswith("UNIQUE"):
        return f"a row with the same {what.replace(f'{table.name}.', '')} stands before; keep one"
    return f"this rule is broken: {what or error}"


def _short(value: object) -> str:
    text = json.dumps(value)
    return text if len(text) <= 80 else f"{text[:77]}..."


def load(lines: Iterable[str], path: Path, *, source: str = "dump", timeout: float = 10.0) -> None:
    """Replace the content of a store by that of a dump, in one transaction.

    Parameters
    ----------
    lines : iterable of str
        As `dump` gives them, with or without line ends.
    path : Path
        The store; made if it is absent.
    source : str
        Name of the text, for complaints.
    timeout : float
        Seconds to wait for another process that holds the store.

    Raises
    ------
    InputError
        With every fault of the text by line (the first hundred); the store is unchanged. Also if `path` is no store.
    LockedError
        If the store is still locked after `timeout`.
    """
    # All rows go to a private database with the same rules first, so that a fault never touches the store.
    with closing(connected(PRIVATE, timeout)) as connection:
        checked = Store(path, kind_of(path), connection, "main", present=True)
        connection.execute("BEGIN")
        create(checked, packed=False)
        run = read_dump(lines, checked, source)
        if checked.kind == "EXT":
            require_names_of_bundles(checked, source)
        with writing([path], timeout=timeout) as stores:
            _take_over(stores[path], checked, run)


PRIVATE = ""
"""SQLite's name for a database of one connection, on disk where it grows large, gone at the end."""


def _take_over(store: Store, checked: Store, run: str | None) -> None:
    tables = dumped_tables(store.kind)
    for table in reversed(tables):
        store.delete(table)
    for table in tables:
        store.insert(table, checked.stored_rows(replace(table, packed=False)))
    set_run(store, run)
