"""User input as messages show it, and what a reader of a file returns."""

from __future__ import annotations

import json
import unicodedata
from typing import Generic, TypeVar

from msgspec import Struct

from orip.errors import Complaint, ProjectWarning

_HIDDEN = frozenset({"Cc", "Cf", "Cs", "Zl", "Zp"})
_JOINERS = "\N{ZERO WIDTH NON-JOINER}\N{ZERO WIDTH JOINER}"
_LONGEST_TOKEN = 40
_LONGEST_MESSAGE = 500


def printable(text: str) -> str:
    """Return a message with characters that cannot be printed written as escapes, and not longer than a few lines."""
    shown = text if text.isprintable() else "".join(map(_escaped, text))
    return shown if len(shown) <= _LONGEST_MESSAGE else shown[: _LONGEST_MESSAGE - 3] + "..."


def has_hidden(text: str) -> bool:
    """Tell whether a text has characters that no reader sees and that make a terminal do something.

    Those are control characters of all kinds, what turns the direction of writing, and halves of characters; but not
    the joiners that some scripts are written with.
    """
    return not text.isprintable() and any(map(_is_hidden, text))


def visible(text: str, kept: str = "") -> str:
    """Return a text with hidden characters written as escapes, except for those that are kept."""
    if text.isprintable() or not has_hidden(text):
        return text
    return "".join(_escaped(one) if _is_hidden(one) and one not in kept else one for one in text)


def visible_json(text: str) -> str:
    """Return a JSON text that means the same, with hidden characters written as JSON's escapes."""
    if not has_hidden(text):
        return text
    return "".join(_json_escape(one) if _is_hidden(one) and one != "\n" else one for one in text)


def _json_escape(character: str) -> str:
    units = character.encode("utf-16-be", "surrogatepass").hex()
    return "".join(f"\\u{units[place : place + 4]}" for place in range(0, len(units), 4))


def _is_hidden(character: str) -> bool:
    return unicodedata.category(character) in _HIDDEN and character not in _JOINERS


def json_fault(fault: json.JSONDecodeError) -> str:
    """Return what is wrong with a text that should be JSON."""
    if not fault.doc.strip():
        return "the file is empty"
    if fault.pos >= len(fault.doc.rstrip()) or fault.msg.startswith("Unterminated string"):
        return "the file is cut off: its end is missing"
    return "something follows the end of the JSON" if fault.msg == "Extra data" else "this is not JSON"


def shown_token(token: str) -> str:
    """Return a word of the user's as messages show it."""
    text = printable(token)
    return text if len(text) <= _LONGEST_TOKEN else text[: _LONGEST_TOKEN - 3] + "..."


def _escaped(character: str) -> str:
    return character if character.isprintable() else character.encode("unicode_escape").decode("ascii")


T = TypeVar("T")


class Parsed(Struct, Generic[T], frozen=True):
    """The outcome of reading one file.

    A reader never stops at the first fault. The caller gathers the complaints of all files and raises one
    `orip.errors.InputError`; the value is good for use only where there are no complaints.

    Parameters
    ----------
    complaints : tuple of Complaint
        In the order of the file's lines as far as they have one.
    """

    value: T
    complaints: tuple[Complaint, ...] = ()
    warnings: tuple[ProjectWarning, ...] = ()
