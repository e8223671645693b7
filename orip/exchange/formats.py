"""The formats of other programs, a line each, and which of them a file or folder probably has."""

from __future__ import annotations

from pathlib import Path

from orip.errors import UsageError
from orip.exchange.colmap.reader import is_model, read_model
from orip.exchange.colmap.writer import write_model
from orip.exchange.format import Format

FORMATS: tuple[Format, ...] = (
    Format("colmap", "COLMAP: folder of a sparse model, text or binary", read_model, is_model, write_model),
)


def format_named(name: str) -> Format:
    """Return the format of a name; case does not count.

    Raises
    ------
    UsageError
        If there is none.
    """
    for found in FORMATS:
        if found.name == name.lower():
            return found
    message = f"there is no format '{name}'; known are: {', '.join(one.name for one in FORMATS)}"
    raise UsageError(message)


def guessed_format(path: Path) -> Format:
    """Return the format that a file or folder probably has.

    Raises
    ------
    UsageError
        If it looks like none, or like several.
    """
    if not path.exists():
        message = f"there is no {path}; name the file or folder of the other program"
        raise UsageError(message)
    found = [one for one in FORMATS if one.read is not None and one.recognises(path)]
    if len(found) == 1:
        return found[0]
    names = ", ".join(one.name for one in found or FORMATS)
    what = "may be of several formats" if found else "looks like none of the formats"
    message = f"{path} {what}; name the format first: 'orip import FORMAT {path}', one of {names}"
    raise UsageError(message)
