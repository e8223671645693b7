"""Tables of names with numbers in files that orip does not read: control or projection centres of another program."""

from __future__ import annotations

import re
from pathlib import Path

from orip.files.text.regular_file import beginning

_ENDINGS = frozenset({".csv", ".dat", ".pnt", ".pts", ".tsv", ".txt", ".xyz"})

_MOST_FILES, _MOST_CHARACTERS = 50, 200_000

_SEPARATORS = re.compile(r"[,;\s]+")
_COORDINATES = 3


def tables_in_folder(folder: Path) -> dict[Path, tuple[str, ...]]:
    """Return the files of a folder with lines of a name and three numbers or more, and these names.

    Of large files only the beginning is looked at; files that cannot be read are left out.
    """
    files = [path for path in sorted(folder.iterdir()) if path.suffix.lower() in _ENDINGS and path.is_file()]
    return {path: names for path in files[:_MOST_FILES] if (names := _names_with_numbers(path))}


def _names_with_numbers(path: Path) -> tuple[str, ...]:
    try:
        text = beginning(path, _MOST_CHARACTERS)
    except (OSError, UnicodeDecodeError):
        return ()
    rows = (_SEPARATORS.split(line.strip()) for line in text.splitlines())
    return tuple(
        dict.fromkeys(row[0].strip("'\"") for row in rows if len(row) > _COORDINATES and all(map(_is_number, row[1:4])))
    )


def _is_number(field: str) -> bool:
    try:
        float(field)
    except ValueError:
        return False
    return True
