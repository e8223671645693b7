"""A table of a text file: comma, semicolon, tab or blanks between fields, names of columns in the first line.

Decimal commas are read where another separator divides the fields and no number of the table has a point; else they are
refused. Fields may be in quotation marks.
"""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from msgspec import Struct

from orip.exchange.sources.text import Faults, text_lines
from orip.files.text.shown import shown_token

_SEPARATORS = (";", "\t", ",")
_COMMENT = "#"
_WITH_COMMA = re.compile(r"[+-]?\d+,\d+(?:[eE][+-]?\d+)?")
_WITH_POINT = re.compile(r"[+-]?\d*\.\d+(?:[eE][+-]?\d+)?")


class Row(Struct, frozen=True):
    """A line of a table: its number, and its fields by column."""

    line: int
    fields: Mapping[str, str]

    def has(self, *columns: str) -> bool:
        """Return whether all of some columns are filled."""
        return all(self.fields.get(column, "") not in {"", "-"} for column in columns)

    def text(self, column: str) -> str:
        """Return a field; empty if there is no such column."""
        return self.fields.get(column, "")


class Table(Struct, frozen=True):
    """The rows of a table, the columns that were recognised, and the complaints about it.

    Parameters
    ----------
    rows : tuple of Row
    columns : tuple of str
        By orip's names.
    ignored : tuple of str
        Headings that were not recognised.
    faults : Faults
    has_decimal_commas : bool
    """

    rows: tuple[Row, ...]
    columns: tuple[str, ...]
    ignored: tuple[str, ...]
    faults: Faults
    has_decimal_commas: bool = False

    def number(self, row: Row, column: str) -> float:
        """Return a field as a number; NaN, and a complaint kept, if it is none, and NaN if it is not filled."""
        if not row.has(column):
            return math.nan
        word = row.text(column)
        return self.faults.decimal(word.replace(",", ".") if self.has_decimal_commas else word, column, row.line)

    def numbers(self, row: Row, columns: Sequence[str]) -> tuple[float, ...]:
        """Return fields as numbers."""
        return tuple(self.number(row, column) for column in columns)


def read_table(path: Path, shown: str, headings: Mapping[str, str], needed: Sequence[str]) -> Table:
    """Read a table.

    Parameters
    ----------
    path : Path
    shown : str
    headings : mapping of str to str
        By orip's name of a column, its names in small letters, separated by blanks.
    needed : sequence of str
        Columns that have to be there.
    """
    faults = Faults(shown)
    lines = [
        (number, line)
        for number, line in enumerate(text_lines(path, faults), start=1)
        if line.strip() and not line.lstrip().startswith(_COMMENT)
    ]
    if not lines:
        if not faults.complaints:
            faults.complain("the table is empty; it needs a line with the names of its columns, and rows")
        return Table((), (), (), faults)
    separator = separator_of(lines[0][1])
    written = fields_of_line(lines[0][1], separator)
    columns, ignored = _columns(written, headings)
    if missing := [name for name in needed if name not in columns.values()]:
        shown_columns = ", ".join(map(shown_token, written))
        faults.complain(
            f"there is no column {', '.join(missing)}; the columns are {shown_columns}. Name it "
            f"{_allowed(missing[0], headings)}",
            lines[0][0],
        )
        return Table((), (), (), faults)
    rows = tuple(_rows(lines[1:], separator, len(written), columns, faults))
    has_commas = separator != "," and _has_decimal_commas(rows)
    return Table(rows, tuple(columns.values()), tuple(ignored), faults, has_commas)


def _allowed(column: str, headings: Mapping[str, str]) -> str:
    return " or ".join(headings[column].split())


def _columns(written: Sequence[str], headings: Mapping[str, str]) -> tuple[dict[int, str], list[str]]:
    """Return orip's names of columns by their places, and the headings that are not known."""
    known = {name: column for column, names in headings.items() for name in names.split()}
    found: dict[int, str] = {}
    ignored = []
    for place, heading in enumerate(written):
        with_unit = re.sub(r"\s*[(\[](mm|px)[)\]]", r"_\1", heading.lower())
        plain = re.sub(r"\(.*?\)|\[.*?\]|[^a-z0-9_]", "", with_unit)
        column = known.get(plain)
        if column is not None and column not in found.values():
            found[place] = column
        else:
            ignored.append(shown_token(heading))
    return found, ignored


def _rows(
    lines: Sequence[tuple[int, str]], separator: str | None, count: int, columns: Mapping[int, str], faults: Faults
) -> Iterator[Row]:
    for number, line in lines:
        fields = fields_of_line(line, separator)
        if len(fields) != count:
            hint = "; with decimal commas the separator has to be a semicolon" if separator == "," else ""
            faults.complain(f"{len(fields)} fields, and the heading has {count}{hint}", number)
            continue
        yield Row(number, {name: fields[place] for place, name in columns.items()})


def separator_of(heading: str) -> str | None:
    """Return what separates the fields of a table with a heading; None: blanks."""
    return next((mark for mark in _SEPARATORS if mark in heading), None)


def fields_of_line(line: str, separator: str | None) -> list[str]:
    """Return the fields of a line, which may be in quotation marks."""
    if separator is None:
        return line.split()
    try:
        fields = next(csv.reader([line], delimiter=separator, skipinitialspace=True), [])
    except csv.Error:
        fields = line.split(separator)
    return [field.strip() for field in fields]


def _has_decimal_commas(rows: Sequence[Row]) -> bool:
    """Return whether numbers have decimal commas, and none has a point."""
    words = [word for row in rows for word in row.fields.values()]
    return any(map(_WITH_COMMA.fullmatch, words)) and not any(map(_WITH_POINT.fullmatch, words))
