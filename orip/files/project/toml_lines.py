"""TOML: the one place where it is parsed, where each key stands, and what is wrong in a text that is not TOML."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Sequence
from functools import cached_property
from typing import Any

from msgspec import Struct, field

from orip.errors import Complaint
from orip.files.text.shown import printable

# The library's parser needs memory and time with the square of the parts of a dotted key, and the stack of the machine
# for arrays in arrays.


DEEPEST = 12
"""Parts of a key, and brackets in one another; a project file has three."""

_USUAL_PARTS, _MOST_PARTS = 2, 20_000
"""Parts of a key, beyond which they are counted, and how many more than that a text may have in all."""

_NESTING_TOKEN = re.compile(
    r'"""(?:[^\\]|\\.)*?(?:"""|\Z)|'
    r"'''.*?(?:'''|\Z)|"
    r'"(?:[^"\\\n]|\\.)*+"?|'
    r"'[^'\n]*+'?|#[^\n]*|[\[\]{}=,.\n]",
    re.DOTALL,
)
"""Texts that do not end are tokens, too: each character is looked at once."""


class NestingError(ValueError):
    """A text is nested more deeply than orip reads; `line` says where, counted from 1."""

    def __init__(self, what: str, line: int, most: int = DEEPEST) -> None:
        super().__init__(f"{what}, and up to {most} are read; a project file needs three at most")
        self.line = line


def toml_document(text: str) -> dict[str, Any]:
    """Return a TOML text as `tomllib` reads it.

    Raises
    ------
    NestingError
        If it is nested too deeply.
    ValueError
        If it is not TOML: tomllib.TOMLDecodeError, or a whole number of thousands of digits.
    """
    _require_flat(text)
    return tomllib.loads(text)


def _require_flat(text: str) -> None:
    line, depth, parts, unusual = 1, 0, 1, 0
    for match in _NESTING_TOKEN.finditer(text):
        token = match.group()
        if token == ".":
            parts += 1
            unusual += parts > _USUAL_PARTS
            if parts > DEEPEST:
                what = "a key has more parts with dots between them"
                raise NestingError(what, line)
            if unusual > _MOST_PARTS:
                what = "the keys of the file have more third and further parts"
                raise NestingError(what, line, _MOST_PARTS)
            continue
        if token[0] in "\"'#":
            line += token.count("\n")  # a part of a key may be in quotes: dots go on counting
            continue
        parts = 1
        if token == "\n":
            line += 1
        elif token in "[{":
            depth += 1
            if depth > DEEPEST:
                what = "more brackets are open in one another"
                raise NestingError(what, line)
        elif token in "]}":
            depth = max(depth - 1, 0)


_PLACE = re.compile(r" \(at (?:line (\d+), column (\d+)|end of document)\)$")

_MEANT_BY_REASON = (
    (re.compile("Cannot overwrite a value"), "this key is written twice; keep one of the two lines"),
    (re.compile("Cannot declare .* twice"), "this table is written twice; join the two (or write [[...]] for a list)"),
    (re.compile(r"Illegal character '\\n'"), "a quotation mark is missing at the end of the text"),
    (re.compile("Unclosed (array|inline table)"), "a comma between two items, or the closing bracket, is missing"),
    (re.compile("Invalid hex value|Unescaped"), "a text has a backslash; write / instead"),
)
"""What the parser says, and what was probably done."""

_MEANT_BY_TEXT = (
    (
        re.compile("<{7}|={7}|>{7}"),
        "git could not merge two versions here; choose one of them",
    ),
    (re.compile("[“”„‟‘’‚«»]"), 'these are typographic quotation marks; write straight ones (")'),
    (re.compile("[\u00a0\u2000-\u200b\u202f\ufeff]"), "this is a blank of a word processor; write an ordinary one"),
    (re.compile("!|//"), "no comment begins so here; write '#'"),
    (re.compile(";"), "no ';' ends a line here; remove it"),
    (re.compile(":"), "a key and its value are separated by '='"),
    (re.compile(r"\{$|\{ *\""), 'this is JSON; write for example [project] and below it name = "ZURICH"'),
    (re.compile(",$"), "no comma ends a line here; remove it"),
    (re.compile(r"\.[0-9]"), "a number begins with a digit; write for example 0.5"),
    (re.compile("true|false", re.IGNORECASE), "write true or false, in small letters"),
)
"""What is at the place of the fault, and what was probably meant."""

_MEANT_BY_VALUE = (
    (re.compile("(#.*)?$"), "a value is missing after '='"),
    (re.compile(r"(null|none)\b", re.IGNORECASE), "there is no such value; leave the key out"),
    (re.compile(r"(?P<word>[^\W\d][^\s,\]}#]*)"), r'a text needs quotation marks; write "\g<word>"'),
)
"""What is there in the place of a value, and what was probably meant."""

_LEADING_ZERO = re.compile(r"(?<![\w.])0(?P<rest>[0-9]+)")
_DECIMAL_COMMA = re.compile(r"[0-9],[0-9]")


def syntax_complaint(fault: str, text: str, shown: str) -> Complaint:
    """Return the complaint about a text that is not TOML, from the message of the library's parser."""
    place = _PLACE.search(fault)
    reason = fault[: place.start()] if place else fault
    if place is None:
        return Complaint(printable(f"this is not TOML: {reason}; correct the text there"), shown)
    if place.group(1) is None:
        ending = _meant(reason, "") or f"{reason} at the end of the text"
        return Complaint(printable(f"this is not TOML: {ending}"), shown, text.count("\n") + 1)
    line, column = int(place.group(1)), int(place.group(2))
    written = text.split("\n")[line - 1]
    if _DECIMAL_COMMA.match(written[max(column - 2, 0) :]):
        meant = "a number has a decimal comma; write a decimal point"
    elif zero := _LEADING_ZERO.match(written, max(column - 2, 0)):
        meant = f'a number does not begin with 0; write {zero["rest"].lstrip("0")}, or "{zero[0]}" if it is a name'
    else:
        meant = _meant(reason, written[column - 1 :]) or f"{reason}; correct the text there"
    return Complaint(printable(f"this is not TOML: {meant}"), shown, line, column)


def _meant(reason: str, here: str) -> str | None:
    """Return what was probably meant, from the parser's reason and from what stands there."""
    by_reason = (meant for pattern, meant in _MEANT_BY_REASON if pattern.match(reason))
    by_text = (meant for pattern, meant in _MEANT_BY_TEXT if pattern.match(here))
    if found := next(by_reason, None) or next(by_text, None):
        return found
    if reason == "Invalid value":
        by_value = (match.expand(meant) for pattern, meant in _MEANT_BY_VALUE if (match := pattern.match(here)))
        return next(by_value, None)
    if reason == "Invalid statement" or reason.startswith("Expected '=' after a key"):
        return "a line is KEY = VALUE or a [table]; correct it, or begin a remark with '#'"
    if reason.startswith("Expected newline") and (word := here.strip().partition(" ")[0]):
        return f"'{word}' follows a value; remove it (numbers have no unit), or begin a comment with '#'"
    return None


KeyPath = tuple[str | int, ...]
"""Keys and array indices that lead to a value, e.g. ``("camera", 0, "fiducials", 2, "x")``."""

_TOKEN = re.compile(
    r"""
      (?P<blank>   [ \t\r]+ | \#[^\n]* )
    | (?P<newline> \n )
    | (?P<quoted>  \"{3} (?:\\.|[^\\])*? \"{3}\"{0,2} | '{3} .*? '{3}'{0,2} | "(?:\\.|[^"\\\n])*" | '[^'\n]*' )
    | (?P<mark>    [\[\]{},=] )
    | (?P<bare>    [^\s\[\]{},=#"']+ )
    | (?P<other>   . )
    """,
    re.VERBOSE | re.DOTALL,
)


class _Open(Struct):
    """An array or inline table that is not closed yet."""

    path: KeyPath
    is_array: bool
    index: int = 0


class TomlLines:
    """Line numbers of the keys, tables and array elements of a TOML text.

    Parameters
    ----------
    text : str
        A text that `tomllib` accepts; of any other the lines may be wrong, but nothing is raised.
    """

    def __init__(self, text: str) -> None:
        self._text = text

    @cached_property
    def _lines(self) -> dict[KeyPath, int]:
        # when a line is first asked for: a text without faults is not scanned
        return _Scan(self._text).lines

    def line_of(self, path: Sequence[str | int]) -> int:
        """Return the line of a value, or of the nearest table around it in the text; 1 at least."""
        for length in range(len(path), 0, -1):
            line = self._lines.get(tuple(path[:length]))
            if line is not None:
                return line
        return 1


class _Scan(Struct):
    """One pass over the text. `pending` holds the words of a key until its ``=`` or the end of its header."""

    text: str
    lines: dict[KeyPath, int] = field(default_factory=dict)
    line: int = 1
    table: KeyPath = ()
    key: KeyPath = ()
    pending: list[str] = field(default_factory=list)
    in_value: bool = False
    header_marks: int = 0
    open: list[_Open] = field(default_factory=list)
    table_counts: dict[KeyPath, int] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for match in _TOKEN.finditer(self.text):
            kind, token = match.lastgroup, match.group()
            if kind == "newline":
                self._end_line()
            elif kind == "mark":
                self._take_mark(token)
            elif kind != "blank":
                self._take_word(token)
            self.line += token.count("\n")

    def _end_line(self) -> None:
        if not self.open:
            self.in_value, self.header_marks = False, 0
            self.pending.clear()

    def _take_word(self, token: str) -> None:
        if self.in_value:
            self._record(self._value_path())
        else:
            self.pending.append(token)

    def _take_mark(self, mark: str) -> None:
        if not self.in_value and not self.open and mark in "[]":
            self._take_header_mark(mark)
        elif mark == "=":
            self._begin_value()
        elif mark in "[{":
            path = self._value_path()
            self._record(path)
            self.open.append(_Open(path, is_array=mark == "["))
            self.in_value = mark == "["
            self.pending.clear()
        elif mark == ",":
            self._next_element()
        elif self.open:
            self.open.pop()
            self.in_value = True

    def _take_header_mark(self, mark: str) -> None:
        if mark == "[":
            self.header_marks += 1
            self.pending.clear()
        elif self.pending:
            self._enter_table(_key_parts(self.pending), is_array=self.header_marks > 1)
            self.pending.clear()

    def _enter_table(self, parts: Sequence[str], *, is_array: bool) -> None:
        path: KeyPath = ()
        for part in parts[:-1]:
            path = (*path, part)
            self._record(path)
            if path in self.table_counts:
                path = (*path, self.table_counts[path] - 1)
        path = (*path, *parts[-1:])
        self._record(path)
        if is_array:
            count = self.table_counts.get(path, 0)
            self.table_counts[path] = count + 1
            path = (*path, count)
            self._record(path)
        self.table = path

    def _begin_value(self) -> None:
        if self.in_value:
            return
        path = self.open[-1].path if self.open else self.table
        for part in _key_parts(self.pending):
            path = (*path, part)
            self._record(path)
        self.key = path
        self.pending.clear()
        self.in_value = True

    def _next_element(self) -> None:
        if not self.open:
            return
        if self.open[-1].is_array:
            self.open[-1].index += 1
        self.in_value = self.open[-1].is_array
        self.pending.clear()

    def _value_path(self) -> KeyPath:
        if self.open and self.open[-1].is_array:
            return (*self.open[-1].path, self.open[-1].index)
        return self.key

    def _record(self, path: KeyPath) -> None:
        self.lines.setdefault(path, self.line)


def _key_parts(words: Sequence[str]) -> list[str]:
    """Return the parts of a dotted key; a quoted part may have dots of its own."""
    parts: list[str] = []
    for word in words:
        if word[0] in "\"'":
            parts.append(_unquoted(word))
        else:
            parts += [part for part in word.split(".") if part]
    return parts


def _unquoted(word: str) -> str:
    try:
        return str(toml_document(f"key = {word}")["key"])
    except ValueError:
        return word
