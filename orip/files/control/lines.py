"""Lines of a control text, edited one by one: comments, order, columns and line ends stay as their owner wrote them."""

from __future__ import annotations

import codecs
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path

from msgspec import Struct

from orip.errors import InputError
from orip.files.text.lines import TextField, TextLine, decode_lines, existing_bytes, split_line
from orip.files.text.parsed import Parsed
from orip.structs import replace

_LINE_ENDS = "\r\n"


class ControlLines(Struct, frozen=True):
    """The lines of a text, each with its line end.

    Parameters
    ----------
    lines : tuple of str
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
