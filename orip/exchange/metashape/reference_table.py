"""Reference tables of Metashape (``Export Reference``, CSV): given places and angles of cameras and markers.

The columns are named by a comment that begins with ``#Label``; user and version choose them and what separates them.
Where there is no such line the columns are named by letters as in Metashape's own import: n label, o enabled, x y z
coordinates, X Y Z their accuracies, a b c yaw, pitch and roll, A B C their accuracies, any other letter a column that
is passed over. Their order is never guessed.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Final

from msgspec import Struct

from orip.exchange.sources.faults import Faults
from orip.exchange.sources.text import text_lines
from orip.exchange.tables.table import fields_of_line, separator_of
from orip.files.text.regular_file import beginning
from orip.files.text.shown import shown_token

COORDINATES = ("x", "y", "z")
ACCURACIES = ("accuracy_x", "accuracy_y", "accuracy_z")
ANGLES = ("yaw", "pitch", "roll")
ANGLE_ACCURACIES = ("accuracy_yaw", "accuracy_pitch", "accuracy_roll")

_LETTERS: Final[Mapping[str, str]] = {
    "n": "label",
    "o": "enabled",
    **dict(zip("xyzXYZabcABC", (*COORDINATES, *ACCURACIES, *ANGLES, *ANGLE_ACCURACIES), strict=True)),
}
_HEADINGS: Final[Mapping[str, str]] = {
    "label": "label", "name": "label", "enable": "enabled", "enabled": "enabled", "enableflag": "enabled",
    **{axis: axis for axis in COORDINATES}, **{angle: angle for angle in ANGLES},
    "longitude": "x", "easting": "x", "east": "x", "latitude": "y", "northing": "y", "north": "y",
    "altitude": "z", "height": "z", "elevation": "z",
}  # fmt: skip
_SYSTEM = re.compile(r"#\s*CoordinateSystem\s*:?\s*(.+)", re.IGNORECASE)
_FALSE = {"0", "false", "no"}
_BEGINNING = 4000
_ENDINGS = (".csv", ".txt", ".tsv")


class Reference(Struct, frozen=True):
    """What a table gives of a camera or marker; a triple is empty where one of its numbers is missing.

    Parameters
    ----------
    label : str
    coordinates : tuple of 3 (float or None)
    accuracy : tuple of 3 float, or empty
        Metres.
    angles, angle_accuracy : tuple of 3 float, or empty
        Yaw, pitch and roll, degrees.
    is_enabled : bool
    line : int
    """

    label: str
    coordinates: tuple[float | None, float | None, float | None]
    accuracy: tuple[float, ...] = ()
    angles: tuple[float, ...] = ()
    angle_accuracy: tuple[float, ...] = ()
    is_enabled: bool = True
    line: int = 0


class ReferenceTable(Struct, frozen=True):
    """A table.

    Parameters
    ----------
    crs : str
        What its coordinates refer to; empty where it does not say.
    references : tuple of Reference
    """

    crs: str
    references: tuple[Reference, ...]


def reference_tables_beside(document: Path) -> list[Path]:
    """Return the tables in the folder of a document that begin as Metashape writes them."""
    return sorted(path for path in document.parent.iterdir() if path.suffix.lower() in _ENDINGS and _is_table(path))


def _is_table(path: Path) -> bool:
    lines = beginning(path, _BEGINNING).splitlines() if path.is_file() else []
    return any(line.startswith("#") and "x" in _columns_of_heading(line) for line in lines)


def read_reference_table(path: Path, faults: Faults, letters: str = "") -> ReferenceTable:
    """Read a table; what is wrong with it is kept with its line.

    Parameters
    ----------
    path : Path
    faults : Faults
    letters : str
        Names of the columns, a letter each; empty: the table's heading names them.
    """
    lines = text_lines(path, faults)
    if faults.complaints:
        return ReferenceTable("", ())
    systems = [match[1].strip() for line in lines if (match := _SYSTEM.match(line))]
    rows = _lettered(lines, letters) if letters else _headed(lines, faults)
    references = [
        found for number, fields, separator in rows if (found := _reference(fields, separator, number, faults))
    ]
    return ReferenceTable(systems[0] if systems else "", tuple(references))


def require_letters(letters: str) -> str | None:
    """Return what is wrong with the letters of columns; None if they have a label and coordinates, each once."""
    known = [letter for letter in letters if letter in _LETTERS]
    if not letters.isalpha() or len(set(known)) < len(known) or not {"n", "x", "y"} <= set(known):
        return "write a letter for each column, such as nxyzXYZabc: n label, x y z coordinates, X Y Z accuracies"
    return None


_Fields = tuple[int, Mapping[str, str], str | None]


def _lettered(lines: Sequence[str], letters: str) -> Iterator[_Fields]:
    columns = {_LETTERS[letter]: place for place, letter in enumerate(letters) if letter in _LETTERS}
    filled = [(number, line) for number, line in enumerate(lines, 1) if line.strip() and not line.startswith("#")]
    separator = separator_of(filled[0][1]) if filled else None
    for number, line in filled:
        fields = fields_of_line(line, separator)
        yield number, {name: fields[place] for name, place in columns.items() if place < len(fields)}, separator


def _headed(lines: Sequence[str], faults: Faults) -> Iterator[_Fields]:
    """Yield the rows below headings that name coordinates; scale bars have a heading of their own without them."""
    columns: dict[str, int] = {}
    separator: str | None = None
    is_headed = False
    for number, line in enumerate(lines, 1):
        found = _columns_of_heading(line) if line.startswith("#") or not is_headed else {}
        if found:
            columns, separator, is_headed = found, separator_of(line), True
        elif line.strip() and not line.startswith("#") and {"x", "y"} <= set(columns):
            fields = fields_of_line(line, separator)
            if len(fields) <= max(columns[name] for name in ("label", "x", "y")):
                faults.complain(f"{len(fields)} fields, and label and coordinates are beyond; correct the row", number)
                continue
            yield number, {name: fields[place] for name, place in columns.items() if place < len(fields)}, separator
    if not is_headed:
        faults.complain(
            "no line names the columns: it begins with #Label; name them with --reference-columns, a letter each, such "
            "as nxyzXYZ",
            1,
        )


def _columns_of_heading(line: str) -> dict[str, int]:
    """Return the columns that a heading names by what they hold; nothing if the line is not a heading."""
    written = fields_of_line(line.lstrip("# \t"), separator_of(line))
    found: dict[str, int] = {}
    for place, heading in enumerate(written):
        for name in _held(heading):
            found.setdefault(name, place)
    return found if found.get("label") == 0 else {}


def _held(heading: str) -> tuple[str, ...]:
    """Return what a column holds; nothing for errors and estimates, which Metashape has computed."""
    text = heading.strip().lower()
    plain = re.sub(r"\(.*?\)|\s", "", text).strip("_")
    if plain.startswith(("accuracy", "acc_")):
        of = plain.removeprefix("accuracy").removeprefix("acc_").strip("_")
        if not of:
            return ANGLE_ACCURACIES if "deg" in text else ACCURACIES
        names = [f"accuracy_{part}" for part in of.split("/")]
        return tuple(name for name in names if name in ACCURACIES + ANGLE_ACCURACIES)
    name = _HEADINGS.get(plain) or _HEADINGS.get(plain.partition("/")[0])
    return () if name is None else (name,)


def _reference(fields: Mapping[str, str], separator: str | None, line: int, faults: Faults) -> Reference | None:
    def number(name: str) -> float | None:
        word = fields.get(name, "").strip()
        if not word:
            return None
        value = faults.decimal(word if separator == "," else word.replace(",", "."), name, line)
        return None if math.isnan(value) else value

    def triple(names: tuple[str, ...]) -> tuple[float, ...]:
        values = [number(name) for name in names]
        return tuple(value for value in values if value is not None) if None not in values else ()

    label = fields.get("label", "").strip()
    x, y, z = (number(name) for name in COORDINATES)
    if not label:
        faults.complain("the row has no label; correct it", line)
    accuracy = triple(ACCURACIES)
    for names, values in ((ACCURACIES, accuracy), (ANGLE_ACCURACIES, angle_accuracy := triple(ANGLE_ACCURACIES))):
        if any(value < 0.0 for value in values):
            faults.complain(f"{names[0].partition('_')[0]} of '{shown_token(label)}' is below 0; correct it", line)
    if not label or (x is None and y is None and z is None):
        return None
    is_enabled = fields.get("enabled", "1").strip().lower() not in _FALSE
    return Reference(label, (x, y, z), accuracy, triple(ANGLES), angle_accuracy, is_enabled, line)
