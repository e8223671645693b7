"""A text that is not TOML: where the fault is, and what was probably meant there."""

from __future__ import annotations

import re

from orip.errors import Complaint
from orip.files.text.shown import printable

_PLACE = re.compile(r" \(at (?:line (\d+), column (\d+)|end of document)\)$")

_MEANT_BY_REASON = (
    (re.compile("Cannot overwrite a value"), "this key is written twice; keep one of the two lines"),
    (re.compile("Cannot declare .* twice"), "this table is written twice; join the two (or write [[...]] for a list)"),
    (re.compile(r"Illegal character '\\n'"), "a quotation mark is missing at the end of the text"),
    (re.compile("Invalid hex value|Unescaped"), "a text has a backslash; write / instead"),
)
"""What the parser says, and what was probably done."""

_MEANT_BY_TEXT = (
    (re.compile("[“”„‟‘’‚«»]"), 'these are typographic quotation marks; write straight ones (")'),
    (re.compile("!"), "'!' begins no comment here; write '#'"),
    (re.compile(";"), "no ';' ends a line here; remove it"),
    (re.compile(":"), "a key and its value are separated by '='"),
    (re.compile(r"\.[0-9]"), "a number begins with a digit; write for example 0.5"),
    (re.compile("true|false", re.IGNORECASE), "write true or false, in small letters"),
)
"""What is at the place of the fault, and what was probably meant."""

_DECIMAL_COMMA = re.compile(r"[0-9],[0-9]")
_WORD = re.compile(r"[^\W\d][^\s,\]}#]*")


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
    else:
        meant = _meant(reason, written[column - 1 :]) or f"{reason}; correct the text there"
    return Complaint(printable(f"this is not TOML: {meant}"), shown, line, column)


def _meant(reason: str, here: str) -> str | None:
    """Return what was probably meant, from the parser's reason and from what stands there."""
    by_reason = (meant for pattern, meant in _MEANT_BY_REASON if pattern.match(reason))
    by_text = (meant for pattern, meant in _MEANT_BY_TEXT if pattern.match(here))
    found = next(by_reason, None) or next(by_text, None)
    word = _WORD.match(here)
    if found is None and word and reason == "Invalid value":
        return f'a text needs quotation marks; write "{word.group()}"'
    return found
