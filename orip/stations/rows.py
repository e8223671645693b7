"""Rows of foreign text files: numbers in named columns, every fault kept with its place."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from pathlib import Path

from msgspec import Struct, field

from orip.errors import Complaint
from orip.files.text.decimal_numbers import parse_number
from orip.files.text.lines import read_bytes
from orip.files.text.shown import printable, shown_token

MOST_COMPLAINTS = 200
"""After so many faults the rest of a file is not read: it is probably of another kind."""

LARGEST_PLACE = 1e8
"""Metres; the largest coordinate that a place on the earth has."""


class Row(Struct, frozen=True):
    """A line with its fields; `column` (from 1) of each."""

    number: int
    fields: tuple[str, ...]
    column: tuple[int, ...]


class RowReader(Struct):
    """Reads fields of rows and keeps what is wrong with them."""

    shown: str
    complaints: list[Complaint] = field(default_factory=list)

    @property
    def is_full(self) -> bool:
        """Return whether the rest of the file is not worth reading."""
        return len(self.complaints) >= MOST_COMPLAINTS

    def complain(self, message: str, row: Row, index: int | None = None) -> None:
        """Keep a complaint about a row, or about one of its fields."""
        column = row.column[index] if index is not None and index < len(row.column) else None
        self.complaints.append(Complaint(printable(message), self.shown, row.number, column))

    def number(self, row: Row, index: int, least: float = -math.inf, largest: float = math.inf) -> float:
        """Return a field that is a number within limits; NaN, and a complaint kept, if it is not one."""
        try:
            value = parse_number(row.fields[index])
        except ValueError as fault:
            self.complain(str(fault), row, index)
            return math.nan
        if not least <= value <= largest:
            shown = shown_token(row.fields[index])
            text = f"'{shown}' is not between {least:g} and {largest:g}; correct it, or name the columns"
            self.complain(text, row, index)
            return math.nan
        return value

    def numbers(self, row: Row, indices: Sequence[int]) -> list[float]:
        """Return fields that are numbers."""
        return [self.number(row, index) for index in indices]


def text_rows(path: Path, reader: RowReader, separators: str = r"\s") -> Iterator[Row]:
    """Iterate over the lines of a file that have fields, comments included.

    Bytes that are not UTF-8 are replaced: they stand in paths and comments alone.
    """
    data, complaints = read_bytes(path, reader.shown)
    reader.complaints += complaints
    yield from rows_of(data or b"", separators)


def rows_of(data: bytes, separators: str = r"\s") -> Iterator[Row]:
    """Iterate over the rows of a text."""
    pattern = re.compile(rf"[^{separators}]+")
    text = data.removeprefix(b"\xef\xbb\xbf").decode("utf-8", errors="replace")
    for number, line in enumerate(text.split("\n"), start=1):
        found = [(match[0], match.start() + 1) for match in pattern.finditer(line.rstrip("\r"))]
        if found:
            yield Row(number, tuple(word for word, _ in found), tuple(column for _, column in found))
