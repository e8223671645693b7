"""Lines of control texts edited one by one, under the keys of a command line: comments and columns stay as they are."""

from __future__ import annotations

import codecs
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

from msgspec import Struct

from orip.errors import InputError
from orip.files.control.preliminary_text import parse_preliminary
from orip.files.control.stations_text import (
    DIFFERENCE_KEYS,
    OPTIONAL_DIFFERENCE_KEYS,
    OPTIONAL_KEYS,
    STATION_KEYS,
    is_heading,
    parse_differences,
    parse_stations,
)
from orip.files.control.text import parse_directions, parse_distances, parse_elements, parse_figures, parse_points
from orip.files.text.decimal_numbers import is_number, parse_number
from orip.files.text.lines import TextField, TextLine, decode_lines, existing_bytes, split_line
from orip.files.text.shown import Parsed, printable, shown_token
from orip.records.names import record_key
from orip.structs import replace

_LINE_ENDS = "\r\n"


class ControlLines(Struct, frozen=True):
    """The lines of a text, each with its line end.

    Parameters
    ----------
    mark : str
        The byte order mark, if the file begins with one.
    """

    lines: tuple[str, ...] = ()
    mark: str = ""

    @property
    def text(self) -> str:
        """Return the whole text."""
        return self.mark + "".join(self.lines)

    @property
    def parsed(self) -> Parsed[list[str]]:
        """Return the lines without line ends as a reader of the whole text gets them."""
        return decode_lines(self.text.encode("utf-8"), "")

    @property
    def line_end(self) -> str:
        """Return the line end of the first line, that of a new one."""
        first = self.lines[0] if self.lines else ""
        return first[len(first.rstrip(_LINE_ENDS)) :] or "\n"

    def records(self) -> Iterator[TextLine]:
        """Iterate over the lines that have fields."""
        for number, line in enumerate(self.parsed.value, start=1):
            split = split_line(line, number)
            if split is not None:
                yield split

    def with_fields(self, number: int, values: Mapping[int, str]) -> ControlLines:
        """Return the text with fields of a line, by index, replaced or appended after its last one."""
        line = self.lines[number - 1]
        for index in sorted(values):
            line = _with_field(line, index, values[index])
        return self._with_line(number, line)

    def without_fields(self, number: int, count: int) -> ControlLines:
        """Return the text with the first `count` fields of a line alone; its comment stays."""
        line = self.lines[number - 1]
        split = split_line(line.rstrip(_LINE_ENDS), number)
        if split is None or len(split.fields) <= count:
            return self
        return self._with_line(number, line[: _end(split.fields[count - 1])] + line[_end(split.fields[-1]) :])

    def with_record(self, fields: Sequence[str], before: int | None, names: int) -> ControlLines:
        """Return the text with a line more: before a line of that number, else at the end.

        Its columns are those of the line that it comes after; the first `names` fields are flush left.
        """
        index = len(self.lines) if before is None else before - 1
        lines = list(self.lines)
        if index > 0 and lines[index - 1] == lines[index - 1].rstrip(_LINE_ENDS):
            lines[index - 1] += self.line_end
        pattern = [record for record in self.records() if record.number <= index][-1:] or list(self.records())[:1]
        lines.insert(index, _aligned(fields, pattern[0] if pattern else None, names) + self.line_end)
        return replace(self, lines=tuple(lines))

    def without_lines(self, numbers: Iterable[int]) -> ControlLines:
        """Return the text without some lines."""
        gone = set(numbers)
        kept = (line for number, line in enumerate(self.lines, start=1) if number not in gone)
        return replace(self, lines=tuple(kept))

    def _with_line(self, number: int, line: str) -> ControlLines:
        return replace(self, lines=(*self.lines[: number - 1], line, *self.lines[number:]))


def read_control_lines(path: Path, shown: str) -> ControlLines:
    """Read the lines of a file; none if it is absent.

    Raises
    ------
    InputError
        If it cannot be read or is not UTF-8.
    """
    data = existing_bytes(path, shown)
    if data is None:
        return ControlLines()
    decoded = decode_lines(data, shown)
    if decoded.complaints:
        raise InputError(decoded.complaints)
    raw = data.removeprefix(codecs.BOM_UTF8)
    lines = tuple(line.decode("utf-8") for line in raw.splitlines(keepends=True))
    return ControlLines(lines, "\ufeff" if len(raw) < len(data) else "")


def _with_field(line: str, index: int, text: str) -> str:
    """Return a line with one field replaced; it ends where the old one ended if the blanks before it allow that."""
    split = split_line(line.rstrip(_LINE_ENDS), 1)
    fields = split.fields if split is not None else ()
    if index >= len(fields):
        end = _end(fields[-1])
        return f"{line[:end]} {text}{line[end:]}"
    field = fields[index]
    start, end = field.column - 1, _end(field)
    if index == 0:
        after = line[end:].lstrip(" ")
        blanks = len(line) - end - len(after)
        room = max(blanks - (len(text) - len(field.text)), min(blanks, 1))
        return line[:start] + text + " " * room + after
    before = line[:start].rstrip(" ")
    room = max(end - len(text) - len(before), min(start - len(before), 1))
    return before + " " * room + text + line[end:]


def _end(field: TextField) -> int:
    """Return how much of the line stands up to the end of a field."""
    return field.column - 1 + len(field.text)


def _aligned(fields: Sequence[str], pattern: TextLine | None, names: int) -> str:
    line = ""
    for index, text in enumerate(fields):
        column = len(line) + 2 if index else 0
        if pattern is not None and index < len(pattern.fields):
            model = pattern.fields[index]
            start = model.column - 1 + (0 if index < names else len(model.text) - len(text))
            column = max(start, len(line) + 1 if index else 0)
        line = line.ljust(column) + text
    return line


ControlKind = Literal[
    "points", "elements", "distances", "directions", "figures", "stations", "differences", "preliminary"
]
Fields = list[str | None]
"""Fields of a line in the order of the keys; None: missing."""

UNKNOWN = "-"
REJECTED = "x"


class ControlForm(Struct, frozen=True):
    """The form of a line.

    Parameters
    ----------
    singular : str
        What one line is.
    extension : str
        Of the file.
    keys : tuple of str
        Of the fields in their order; the first is the record's name.
    identity : int
        How many fields tell a record from others; those after them are numbers.
    parse : function of a text's lines and the file's name
    words : tuple of str
        Keys of fields that are words: case does not count.
    errors : tuple of str
        Keys of a-priori errors.
    texts : tuple of str
        Keys of fields after the identity that are not numbers.
    optional : tuple of tuples of str
        Groups of the last keys; any number of groups may be missing from the end.
    dashes : tuple of str
        Keys of fields that are ``-`` where nothing is known.
    is_heading : function of a line
        Tells lines that say something of all records, and are none.
    rejects : bool
        A last field ``x`` rejects the record.
    """

    singular: str
    extension: str
    keys: tuple[str, ...]
    identity: int
    parse: Callable[[Parsed[list[str]], str], Parsed[tuple[Any, ...]]]
    words: tuple[str, ...] = ()
    errors: tuple[str, ...] = ()
    texts: tuple[str, ...] = ()
    optional: tuple[tuple[str, ...], ...] = ()
    dashes: tuple[str, ...] = ()
    rejects: bool = False
    is_heading: Callable[[TextLine], bool] = lambda _: False

    def records(self, lines: ControlLines) -> Iterator[TextLine]:
        """Iterate over the lines of a text that are records."""
        return (line for line in lines.records() if not self.is_heading(line))

    def fields_of(self, line: TextLine) -> Fields:
        """Return the fields of a line, as many as there are keys."""
        texts: Fields = [field.text for field in line.fields[: self.count(line)]]
        return texts + [None] * (len(self.keys) - len(texts))

    def is_rejected(self, line: TextLine) -> bool:
        """Tell whether a line ends with what rejects its record."""
        return self.rejects and len(line.fields) > 1 and line.fields[-1].text.lower() == REJECTED

    def count(self, line: TextLine) -> int:
        """Return how many fields of a line are of the record."""
        return min(len(line.fields) - self.is_rejected(line), len(self.keys))

    def identity_of(self, fields: Sequence[str | None]) -> tuple[str, ...]:
        """Return what tells a record from others, in the form in which it is compared."""
        texts = [text or "" for text in fields[: self.identity]]
        is_record = self.singular == "element" and texts[1:2] and texts[1].upper() in {"CAMERA", "PHOTO"}
        if is_record or self.singular == "station":
            texts[0] = record_key(texts[0])
        if self.singular == "station difference":
            texts = [record_key(text) for text in texts]
        return tuple(text.upper() if key in self.words else text for key, text in zip(self.keys, texts, strict=False))

    def is_meant(self, wanted: str, fields: Sequence[str | None]) -> bool:
        """Tell whether the first fields of a record are those that somebody wrote, separated by blanks."""
        parts = wanted.split()
        full = [*parts, *[text or "" for text in fields[len(parts) :]]]
        return 0 < len(parts) <= self.identity and self.identity_of(full) == self.identity_of(fields)


FORMS: dict[ControlKind, ControlForm] = {
    "points": ControlForm(
        "control point",
        "PNT",
        ("name", "X", "Y", "Z", "aX", "aY", "aZ", "rXY", "rXZ", "rYZ"),
        1,
        parse_points,
        errors=("aX", "aY", "aZ"),
        optional=(("rXY", "rXZ", "rYZ"),),
        dashes=("X", "Y", "Z", "aX", "aY", "aZ"),
        rejects=True,
    ),
    "elements": ControlForm(
        "element",
        "ELE",
        ("name", "group", "kind", "value", "a"),
        3,
        parse_elements,
        words=("group", "kind"),
        errors=("a",),
    ),
    "distances": ControlForm(
        "distance",
        "LEN",
        ("name", "from", "to", "code", "distance", "a"),
        4,
        parse_distances,
        words=("code",),
        errors=("a",),
    ),
    "directions": ControlForm(
        "direction",
        "DIR",
        ("set", "station", "target", "direction", "a", "zenith", "azenith"),
        3,
        parse_directions,
        errors=("a", "azenith"),
        optional=(("zenith", "azenith"),),
    ),
    "figures": ControlForm(
        "point of a figure",
        "CON",
        ("figure", "kind", "point", "a", "to", "dX", "dY", "dZ"),
        3,
        parse_figures,
        words=("kind",),
        errors=("a",),
        texts=("to",),
        optional=(("to", "dX", "dY", "dZ"),),
    ),
    "stations": ControlForm(
        "station",
        "STA",
        STATION_KEYS,
        1,
        parse_stations,
        errors=("aX", "aY", "aZ", "aOMEGA", "aPHI", "aKAPPA"),
        dashes=STATION_KEYS[1:],
        texts=("strip",),
        optional=OPTIONAL_KEYS,
        is_heading=is_heading,
    ),
    "differences": ControlForm(
        "station difference",
        "REL",
        DIFFERENCE_KEYS,
        2,
        parse_differences,
        errors=("aX", "aY", "aZ", "aOMEGA", "aPHI", "aKAPPA"),
        dashes=DIFFERENCE_KEYS[2:],
        optional=OPTIONAL_DIFFERENCE_KEYS,
    ),
    "preliminary": ControlForm(
        "preliminary point",
        "PRE",
        ("name", "X", "Y", "Z", "sX", "sY", "sZ"),
        1,
        parse_preliminary,
        optional=(("sX", "sY", "sZ"),),
    ),
}


def with_words(form: ControlForm, fields: Sequence[str | None], words: Iterable[str]) -> tuple[Fields, list[str]]:
    """Return fields with values given as KEY=VALUE, and what is wrong with the words or missing."""
    changed, faults = list(fields), []
    by_lower = {key.lower(): index for index, key in enumerate(form.keys)}
    for word in words:
        key, equals, text = word.partition("=")
        index = by_lower.get(key.strip().lower())
        fault = None
        if not equals or index is None:
            fault = f"this is not KEY=VALUE of a {form.singular}; its keys are: {', '.join(form.keys)}"
        elif text and not is_field(text):
            fault = "a value is one word without blanks, and no comment"
        else:
            changed[index] = _same_number(changed[index], text) if text else None
        faults += [] if fault is None else [printable(f"{shown_token(word)}: {fault}")]
    return _completed(form, changed, faults), faults


def is_field(text: str) -> bool:
    """Tell whether a text would be one field of a line."""
    split = split_line(text, 1)
    return split is not None and [field.text for field in split.fields] == [text]


def _same_number(old: str | None, new: str) -> str:
    """Return the new text, or the old one where it is the same number."""
    if old is not None and is_number(old) and is_number(new) and parse_number(old) == parse_number(new):
        return old
    return new


def _completed(form: ControlForm, fields: Fields, faults: list[str]) -> Fields:
    """Return fields with ``-`` for what is not known, without the last ones that say nothing; say what is missing."""
    given = [
        None if text == UNKNOWN and key in form.dashes else text for key, text in zip(form.keys, fields, strict=True)
    ]
    keys = _needed(form, given)
    found: Fields = [
        UNKNOWN if text is None and key in form.dashes else text for key, text in zip(keys, given, strict=False)
    ]
    missing = [key for key, text in zip(keys, found, strict=True) if text is None]
    group = next((group for group in form.optional if set(missing) <= set(group)), ())
    if missing and group:
        faults.append(f"{' '.join(missing)} missing; give {', '.join(group)} together or none of them")
    elif missing:
        needed = [key for key in missing if not any(key in group for group in form.optional)]
        faults.append(f"{form.singular}: missing {', '.join(needed)}; give {' '.join(f'{key}=...' for key in needed)}")
    return [*found, *[None] * (len(form.keys) - len(found))]


def _needed(form: ControlForm, given: Fields) -> tuple[str, ...]:
    """Return the keys without the last groups of which nothing is given."""
    count = len(form.keys)
    for group in reversed(form.optional):
        if any(text is not None for text in given[count - len(group) : count]):
            break
        count -= len(group)
    return form.keys[:count]
