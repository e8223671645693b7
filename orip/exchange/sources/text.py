"""Texts and tables of numbers in files of other programs, every fault with its place."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
from msgspec import Struct, field

from orip.arrays import FloatArray
from orip.errors import Complaint
from orip.files.text.decimal_numbers import LARGEST_NUMBER, parse_degrees, parse_number
from orip.files.text.lines import foreign_text, no_text_complaint, read_bytes
from orip.files.text.separated import (
    DEGREES,
    EXTRA_FIELDS,
    METRES,
    fields_of_line,
    folded,
    has_decimal_commas,
    separator_of,
    unit_of,
    with_bracketed_length,
)
from orip.files.text.shown import printable, shown_token

MOST_COMPLAINTS = 200
"""More are not kept of a file: it is probably of another kind."""

LARGEST_COUNT = 1 << 53
"""Whole numbers above are not held exactly by programs that read them as decimals."""


class Faults(Struct):
    """Complaints about one file, and words of it read as numbers.

    Parameters
    ----------
    shown : str
        The file as the user would name it.
    """

    shown: str
    complaints: list[Complaint] = field(default_factory=list)

    def complain(self, message: str, line: int | None = None, column: int | None = None) -> None:
        """Keep a complaint, unless there are `MOST_COMPLAINTS`."""
        if len(self.complaints) < MOST_COMPLAINTS:
            self.complaints.append(Complaint(printable(message), self.shown, line, column))

    def is_first(self, name: str, noun: str, line: int, known: dict[str, int]) -> bool:
        """Return whether a name is not yet known with its line; a complaint is kept of one that is."""
        first = known.setdefault(name, line)
        if first != line:
            self.complain(f"{noun} {name} is here again, after line {first}; remove or rename one of them", line)
        return first == line

    def complain_of_end(self, what: str, end: str, line: int) -> None:
        """Complain that the last line of what should end with another one is also that of the file."""
        self.complain(
            f"{what} does not end with {end}: the file is cut off; write it again, or add {end} if it is complete", line
        )

    def decimal(self, word: str, what: str, line: int | None) -> float:
        """Return a word as a number; NaN, and a complaint kept, if it is not one."""
        try:
            return parse_number(word)
        except ValueError as fault:
            self.complain(f"{what}: {fault}", line)
            return math.nan

    def degrees(self, word: str, what: str, sides: str, line: int | None) -> float:
        """Return a word as a longitude or latitude (`parse_degrees`); NaN, and a complaint kept, if it is not one."""
        try:
            return parse_degrees(word, sides)
        except ValueError as fault:
            self.complain(f"{what}: {fault}", line)
            return math.nan

    def decimals(self, text: str, count: int, what: str, line: int | None) -> tuple[float, ...] | None:
        """Return numbers separated by blanks; None, and complaints kept, unless there are as many, all finite."""
        words = text.split(maxsplit=count)
        if len(words) != count or len(words[-1].split()) != 1:
            found = len(text.split()) if len(text) < 1 << 16 else "more"
            self.complain(f"{what}: {count} numbers should be here, {found} found; write {count}", line)
            return None
        values = tuple(self.decimal(word, what, line) for word in words)
        return None if any(map(math.isnan, values)) else values

    def whole(self, word: str, what: str, line: int | None, least: int = 0) -> int | None:
        """Return a word as a whole number; None, and a complaint kept, if it is not one or less than `least`."""
        text = word.strip()
        if (
            text.removeprefix("-").isascii()
            and text.removeprefix("-").isdigit()
            and len(text) < len(str(LARGEST_COUNT))
        ):
            number = int(text)
            if number >= least:
                return number
        self.complain(f"{what}: '{shown_token(word)}' is not a whole number from {least} on; correct it", line)
        return None


_QUOTED = re.compile(r'"([^"]*)"|(\S+)')


def text_lines(path: Path, faults: Faults) -> list[str]:
    """Return the lines of a text in one of the encodings of `foreign_text`."""
    data, complaints = read_bytes(path, faults.shown)
    faults.complaints += complaints
    data = data or b""
    if no_text := no_text_complaint(data, faults.shown):
        faults.complaints.append(no_text)
        return []
    return foreign_text(data).split("\n")


def numbered_words(lines: list[str], comments: str = "") -> Iterator[tuple[int, list[str]]]:
    """Iterate over number, from 1, and words of the lines that have some; not those that begin with `comments`."""
    for number, line in enumerate(lines, start=1):
        words = line.split()
        if words and not (comments and words[0].startswith(tuple(comments))):
            yield number, words


def quoted_words(line: str) -> list[str]:
    """Return the words of a line, of which those with blanks are in quotes."""
    return [match[1] if match[1] is not None else match[2] for match in _QUOTED.finditer(line)]


# Where a line may have a fault nothing is returned, and the reader goes through the lines one by one to name it.

_PLAIN = re.compile(r"[0-9+\-.eE \t\r\n]*")
"""Words of these letters that Python reads as numbers are those that orip takes for numbers."""

_LINES = 50_000
_MOST_DIGITS = 15


def sound_rows(lines: Sequence[str], fields: int, whole: int = 0) -> FloatArray | None:
    """Return the numbers (n, fields) of n lines; None if one of them may have a fault.

    Parameters
    ----------
    fields : int
        Numbers in a line, with blanks between them.
    whole : int
        So many of them, the first ones, are whole numbers from 0 on.
    """
    found = np.empty((len(lines), fields))
    for first in range(0, len(lines), _LINES):
        part = lines[first : first + _LINES]
        text = " ".join(part)
        if _PLAIN.fullmatch(text) is None or set(map(len, map(str.split, part))) != {fields}:
            return None
        words = text.split()
        for column in range(whole):
            own = words[column::fields]
            if not all(map(str.isdigit, own)) or max(map(len, own)) > _MOST_DIGITS:
                return None
        try:
            numbers = np.fromiter(map(float, words), dtype=np.float64, count=len(words))
        except ValueError:
            return None
        if not (np.abs(numbers) <= LARGEST_NUMBER).all():
            return None
        found[first : first + _LINES] = numbers.reshape(-1, fields)
    return found


# Decimal commas are read where another separator divides the fields and no number of the table has a point; else they
# are refused. Fields may be in quotation marks.

_COMMENT = "#"

GROUND_LENGTHS = frozenset(("X", "Y", "Z", "sX", "sY", "sZ", "X0", "Y0", "Z0"))
"""Columns of ground coordinates and their errors."""


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
    columns : tuple of str
        By orip's names.
    ignored : tuple of str
        Headings that were not recognised.
    scale : mapping of str to float
        What numbers of a column are multiplied by: angles are in degrees, lengths on the ground in metres, whatever
        unit the heading names.
    """

    rows: tuple[Row, ...]
    columns: tuple[str, ...]
    ignored: tuple[str, ...]
    faults: Faults
    has_decimal_commas: bool = False
    scale: Mapping[str, float] = field(default_factory=dict)

    def number(self, row: Row, column: str) -> float:
        """Return a field as a number; NaN, and a complaint kept, if it is none, and NaN if it is not filled."""
        if not row.has(column):
            return math.nan
        word = row.text(column)
        value = self.faults.decimal(word.replace(",", ".") if self.has_decimal_commas else word, column, row.line)
        return value * self.scale.get(column, 1.0)

    def numbers(self, row: Row, columns: Sequence[str]) -> tuple[float, ...]:
        """Return fields as numbers."""
        return tuple(self.number(row, column) for column in columns)


def read_table(path: Path, shown: str, headings: Mapping[str, str], needed: Sequence[str]) -> Table:
    """Read a table.

    Parameters
    ----------
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
    written = list(map(with_bracketed_length, fields_of_line(lines[0][1], separator)))
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
    has_commas = separator != "," and has_decimal_commas(word for row in rows for word in row.fields.values())
    scale = {
        name: factors[unit]
        for place, name in columns.items()
        if (unit := unit_of(written[place])) in (factors := METRES if name in GROUND_LENGTHS else DEGREES)
    }
    return Table(rows, tuple(columns.values()), tuple(ignored), faults, has_commas, scale)


def _allowed(column: str, headings: Mapping[str, str]) -> str:
    return " or ".join(headings[column].split())


def _columns(written: Sequence[str], headings: Mapping[str, str]) -> tuple[dict[int, str], list[str]]:
    """Return orip's names of columns by their places, and the headings that are not known."""
    known = {name: column for column, names in headings.items() for name in names.split()}
    found: dict[int, str] = {}
    ignored = []
    for place, heading in enumerate(written):
        with_unit = re.sub(r"\s*[(\[](mm|px)[)\]]", r"_\1", folded(heading))
        names = [re.sub(r"\(.*?\)|\[.*?\]|[^a-z0-9_]", "", text) for text in (with_unit, folded(heading))]
        column = known.get(names[0]) or known.get(names[1])
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
            hint = EXTRA_FIELDS if separator == "," else ""
            faults.complain(f"{len(fields)} fields, and the heading has {count}{hint}", number)
            continue
        yield Row(number, {name: fields[place] for place, name in columns.items()})
