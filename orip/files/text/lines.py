"""Lines of a text file split into fields, and the fields of one line taken one after the other."""

from __future__ import annotations

import codecs
import difflib
import re
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import TypeVar

from msgspec import Struct

from orip.errors import Complaint, InputError
from orip.files.text.decimal_numbers import parse_number
from orip.files.text.regular_file import UTF_16, NoRegularFileError, regular_bytes
from orip.files.text.separated import has_decimal_commas
from orip.files.text.shown import Parsed, printable, shown_token
from orip.records.control import ErrorLimits
from orip.records.names import COMMENT_MARKS, name_fault

DOS_END = b"\x1a"
"""What DOS writes at the end of a text."""

_FIELD = re.compile(r"\S+")
_ZERO = b"\0"
_SAVE = "save its content as plain text (UTF-8)"
_NO_TEXTS = (
    (b"PK\x03\x04", "a workbook (.xlsx, .ods), a document or another ZIP archive", _SAVE),
    (b"\xd0\xcf\x11\xe0", "a workbook or document of an older Office (.xls, .doc)", _SAVE),
    (b"{\\rtf", "formatted text (RTF)", _SAVE),
    (b"%PDF-", "a PDF", _SAVE),
    (b"\x1f\x8b", "compressed (gzip)", "unpack it"),
)
"""How files begin that are given in the place of a text, what they are, and what helps."""
_REMARK = re.compile(r"%|//|;|\*|--|==|__|~")
"""How lines begin that are remarks or rules in other programs."""

_SPREADSHEET_LINE = len("sep=;")
_WEB_PAGE = re.compile(rb"\s*<(?:!doctype html|html)\b", re.IGNORECASE)
_LINE_END = re.compile(r"\r+\n|\r")


class TextField(Struct, frozen=True):
    """One field of a line and the column it starts in, counted from 1."""

    text: str
    column: int


class TextLine(Struct, frozen=True):
    """A line that has fields: its number, counted from 1, and its fields without the comment."""

    number: int
    fields: tuple[TextField, ...]

    @property
    def end_column(self) -> int:
        """Return the column after the last field, where a missing one would stand."""
        last = self.fields[-1]
        return last.column + len(last.text) + 1


def read_bytes(path: Path, shown: str, *, may_be_absent: bool = False) -> tuple[bytes | None, tuple[Complaint, ...]]:
    """Return the bytes of a file, or None and why it cannot be read.

    A file that is absent and may be so gives None and no complaint.
    """
    try:
        return regular_bytes(path), ()
    except FileNotFoundError:
        if may_be_absent:
            return None, ()
        message = "there is no such file; correct the name, or put the file in its place"
    except NoRegularFileError as fault:
        message = f"{fault.strerror}; name the file itself"
    except PermissionError:
        message = "the file may not be read; change its permissions"
    except (OSError, ValueError) as fault:  # ValueError: a NUL in the name
        reason = getattr(fault, "strerror", None) or str(fault)
        message = f"the file cannot be read ({reason}); check the name and the disk"
    return None, (Complaint(message, shown),)


def existing_bytes(path: Path, shown: str) -> bytes | None:
    """Return the bytes of a file; None if it is absent.

    Raises
    ------
    InputError
        If it cannot be read.
    """
    data, complaints = read_bytes(path, shown, may_be_absent=True)
    if complaints:
        raise InputError(complaints)
    return data


def existing_text(path: Path, shown: str) -> str | None:
    """Return a text as it stands; None if it is absent.

    Raises
    ------
    InputError
        If it cannot be read or is not UTF-8.
    """
    data = existing_bytes(path, shown)
    try:
        return None if data is None else data.decode("utf-8")
    except UnicodeDecodeError:
        message = "the file is not UTF-8; save it as UTF-8"
        raise InputError.single(message, shown) from None


def sound_bytes(data: bytes, shown: str) -> Parsed[bytes]:
    """Return a text as UTF-8, each line with a newline; given with or without byte order mark, with any line ends.

    Each line that is not UTF-8 gives a complaint and is left empty.
    """
    if data.startswith(UTF_16):
        return Parsed(b"", (Complaint("the file is UTF-16; save it as UTF-8", shown, 1),))
    if no_text := no_text_complaint(data, shown):
        return Parsed(b"", (no_text,))
    if DOS_END in data and data.rstrip().endswith(DOS_END):
        message = "the file ends in a character of DOS (Ctrl-Z, 0x1A); remove it"
        return Parsed(b"", (Complaint(message, shown, len(data.splitlines())),))
    text = data.removeprefix(codecs.BOM_UTF8)
    if b"\r" in text:
        text = text.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    if text and not text.endswith(b"\n"):
        text += b"\n"
    try:
        if not text.isascii():
            text.decode("utf-8")
    except UnicodeDecodeError:
        lines = _decode_each(text.splitlines(), shown)
        return Parsed("\n".join((*lines.value, "")).encode("utf-8"), lines.complaints)
    return Parsed(text)


def foreign_text(data: bytes) -> str:
    """Return a text that another program wrote, each line end as a newline.

    It is UTF-8, UTF-16 with its byte order mark, or else Windows' western characters: names of photos come from
    programs and systems of all kinds. What DOS writes at the end of a file is left out, and of a line ``sep=;`` for
    spreadsheets at the beginning only its end is left.
    """
    data = foreign_bytes(data)
    try:
        text = data.decode("utf-8")
    except UnicodeDecodeError:
        text = data.decode("cp1252", errors="replace")
    text = _LINE_END.sub("\n", text) if "\r" in text else text
    return text[_SPREADSHEET_LINE:] if re.match(r"sep=[;,|\t]\n", text) else text


def foreign_bytes(data: bytes) -> bytes:
    """Return a text without byte order mark and without what DOS writes at its end; UTF-16 with its mark as UTF-8."""
    if data.startswith(UTF_16):
        data = data.decode("utf-16", errors="replace").encode()
    return data.removeprefix(codecs.BOM_UTF8).removesuffix(DOS_END)


def no_text_complaint(data: bytes, shown: str) -> Complaint | None:
    """Return a complaint about what is no text: a workbook, an archive, bytes with zeros; None of others."""
    for beginning, kind, remedy in _NO_TEXTS:
        if data.startswith(beginning):
            return Complaint(f"this is no text, but {kind}; {remedy}", shown)
    if _WEB_PAGE.match(data.removeprefix(codecs.BOM_UTF8)):
        return Complaint("this is no text, but a web page (HTML); download or export the file itself", shown)
    if _ZERO in data and not data.startswith(UTF_16):
        message = "the file has zero bytes: it is UTF-16, or damaged, or no text at all; save it as UTF-8"
        return Complaint(message, shown, data.count(b"\n", 0, data.index(_ZERO)) + 1)
    return None


def decode_lines(data: bytes, shown: str) -> Parsed[list[str]]:
    """Split bytes into lines of text; see `sound_bytes` for what is complained of."""
    text = sound_bytes(data, shown)
    return Parsed(text.value.decode("utf-8").split("\n")[:-1], text.complaints)


def _decode_each(raw_lines: list[bytes], shown: str) -> Parsed[list[str]]:
    lines: list[str] = []
    complaints: list[Complaint] = []
    for number, raw in enumerate(raw_lines, start=1):
        try:
            lines.append(raw.decode("utf-8"))
        except UnicodeDecodeError as fault:
            lines.append("")
            column = len(raw[: fault.start].decode("utf-8")) + 1
            message = f"byte 0x{raw[fault.start]:02X} is not UTF-8; save the file as UTF-8"
            complaints.append(Complaint(message, shown, number, column))
    return Parsed(lines, tuple(complaints))


def read_sound_bytes(path: Path, shown: str) -> Parsed[bytes]:
    """Return a text file as `sound_bytes`; see there and `read_bytes` for what is complained of."""
    data, complaints = read_bytes(path, shown)
    return Parsed(b"", complaints) if data is None else sound_bytes(data, shown)


def read_lines(path: Path, shown: str, *, may_be_absent: bool = False) -> Parsed[list[str]]:
    """Return the lines of a text file; see `read_bytes` and `decode_lines` for what is complained of."""
    data, complaints = read_bytes(path, shown, may_be_absent=may_be_absent)
    return Parsed([], complaints) if data is None else decode_lines(data, shown)


def sound_text(path: Path, shown: str) -> str:
    """Return a text file as one text, line ends as newlines.

    Raises
    ------
    InputError
        With what `read_lines` complains of.
    """
    lines = read_lines(path, shown)
    if lines.complaints:
        raise InputError(lines.complaints)
    return "\n".join(lines.value)


def split_line(line: str, number: int) -> TextLine | None:
    """Split one line into fields at blanks and tabs; None if there is nothing before the comment.

    ``!`` or ``#`` starts a comment where a field would start; inside a field it belongs to the field.
    """
    fields: list[TextField] = []
    for match in _FIELD.finditer(line):
        if match.group().startswith(COMMENT_MARKS):
            break
        fields.append(TextField(match.group(), match.start() + 1))
    return TextLine(number, tuple(fields)) if fields else None


def field_lines(lines: list[str]) -> Iterator[TextLine]:
    """Iterate over the lines that have fields."""
    for number, line in enumerate(lines, start=1):
        split = split_line(line, number)
        if split is not None:
            yield split


def field_name_fault(text: str) -> str | None:
    """Say what is wrong with a field that is to be a name, and what to do; None if it is fit."""
    fault = name_fault(text)
    if fault is None:
        return None
    if not text.isprintable():
        return f"the name '{shown_token(text)}' has a character that cannot be printed; write it again"
    return f"{fault}; choose another name"


Word = TypeVar("Word", bound=str)


class FieldReader:
    """Reads fields of one line by index and gathers what is wrong with them.

    Parameters
    ----------
    shown : str
        The file as the user would name it.
    """

    def __init__(self, line: TextLine, shown: str) -> None:
        self._line = line
        self._shown = shown
        self.complaints: list[Complaint] = []

    @property
    def number(self) -> int:
        """Return the line's number in the file, counted from 1."""
        return self._line.number

    @property
    def count(self) -> int:
        """Return how many fields the line has."""
        return len(self._line.fields)

    def text(self, index: int) -> str:
        """Return a field as it is written."""
        return self._line.fields[index].text

    def shown_text(self, index: int) -> str:
        """Return a field as a message shows it."""
        return shown_token(self.text(index))

    def complain(self, message: str, index: int | None = None) -> None:
        """Keep a complaint about the line, or about the field of that index."""
        column = None if index is None else self._line.fields[index].column
        self.complaints.append(Complaint(printable(message), self._shown, self.number, column))

    def has_fields(self, allowed: Sequence[int], form: str) -> bool:
        """Check how many fields there are; complain with the form that the line should have."""
        if self.count in allowed:
            return True
        if self.count > max(allowed):
            extra = max(allowed)
            message = f"'{self.shown_text(extra)}' is one field too many; the line is: {form}"
            self.complain(message, extra)
        else:
            remark = "; begin a remark with !" if _REMARK.match(self.text(0)) else self.part_by_blanks()
            message = f"a field is missing, {self.count} found{remark}; the line is: {form}"
            self.complaints.append(Complaint(message, self._shown, self.number, self._line.end_column))
        return False

    def part_by_blanks(self) -> str:
        """Return what to do where fields seem to be separated by commas or semicolons; "" where they are not."""
        written = " ".join(field.text for field in self._line.fields)
        mark = next((mark for mark in ";," if mark in written), None)
        if mark is None:
            return ""
        points = ", and write decimal points" if mark == ";" and has_decimal_commas(written.split(mark)) else ""
        return f"; separate fields by blanks or tabs, not by '{mark}'{points}"

    def is_heading(self, numbers: Iterable[int]) -> bool:
        """Tell whether all fields that are to be numbers begin with a letter, and complain of a heading."""
        if not all(self.text(index)[0].isalpha() for index in numbers):
            return False
        self.complain("this line has no numbers; begin a heading with ! or remove it")
        return True

    def name(self, index: int) -> str:
        """Return a field that is a name."""
        text = self.text(index)
        fault = field_name_fault(text)
        if fault is not None:
            self.complain(fault, index)
        return text

    def decimal(self, index: int) -> float:
        """Return a field that is a number; NaN, and a complaint kept, if it is not one."""
        try:
            return parse_number(self.text(index))
        except ValueError as fault:
            self.complain(str(fault), index)
            return float("nan")

    def number_or_dash(self, index: int) -> float | None:
        """Return a field that is a number or ``-`` (not known: None)."""
        return None if self.text(index) == "-" else self.decimal(index)

    def error(self, index: int, limits: ErrorLimits) -> float:
        """Return a field that is an a-priori error: 0, or of a size within the limits."""
        value = self.decimal(index)
        fault = limits.fault(value)
        if fault is not None:
            self.complain(fault, index)
        return value

    def error_or_dash(self, index: int, limits: ErrorLimits) -> float | None:
        """Return a field that is an a-priori error or ``-`` (not known: None)."""
        return None if self.text(index) == "-" else self.error(index, limits)

    def word(self, index: int, allowed: Sequence[Word], meaning: str) -> Word | None:
        """Return the one of the allowed words that a field is, in any case; None, and a complaint kept, if none."""
        written = self.text(index).upper()
        by_upper = {word.upper(): word for word in allowed}
        if written in by_upper:
            return by_upper[written]
        near = difflib.get_close_matches(shown_token(written), list(by_upper), 1)
        remedy = f"did you mean {by_upper[near[0]]}? Allowed: " if near else "write one of "
        self.complain(f"'{self.shown_text(index)}' is not {meaning}; {remedy}{', '.join(allowed)}", index)
        return None
