"""What a project folder remembers of the project that it was imported from: names, and where the original is.

The place of the original is that from the project folder, so that both can be moved together.
"""

from __future__ import annotations

import csv
import io
import os
from collections.abc import Iterable, Mapping
from pathlib import Path

from msgspec import Struct, field

from orip.errors import InputError
from orip.files.text.lines import read_bytes
from orip.files.text.shown import has_hidden, shown_token
from orip.files.text.toml import toml_document
from orip.records.names import record_key

NAMES_FILE = "names.csv"
SOURCE_FILE = "exchange.toml"
TRACK_MARK = "T"

_LARGEST_SOURCE_FILE = 1 << 16
"""Bytes: what orip writes there are two lines; a larger file is not its own."""

_HEADING = ["kind", "orip", "original"]
_RECORDS = ("camera", "photo")


class NamesTable(Struct, frozen=True):
    """Original names by orip's; those of cameras and photos by `record_key`.

    Names that are not listed are the original ones; a tie point T17 is track 17. Points are those with names of their
    own, tracks those with numbers.
    """

    cameras: Mapping[str, str] = field(default_factory=dict)
    photos: Mapping[str, str] = field(default_factory=dict)
    points: Mapping[str, str] = field(default_factory=dict)
    tracks: Mapping[str, str] = field(default_factory=dict)

    def original_mark(self, name: str) -> str:
        """Return the original name of a point that is no track, as control points are."""
        return self.points.get(name, name)

    def original_point(self, name: str) -> tuple[str, bool]:
        """Return the original name of a point that is not control, and whether it is the number of a track."""
        if name in self.points:
            return self.points[name], False
        if name in self.tracks:
            return self.tracks[name], True
        is_track = is_named_as_track(name)
        return (name.removeprefix(TRACK_MARK) if is_track else name), is_track


def is_named_as_track(name: str) -> bool:
    """Tell whether a name looks like that of a track: T and a number."""
    number = name.removeprefix(TRACK_MARK)
    return number != name and number.isascii() and number.isdigit()


class Original(Struct, frozen=True):
    """The format and the path of the project that was imported."""

    format: str
    path: Path


def names_text(rows: Iterable[tuple[str, str, str]]) -> str:
    """Return a table of (kind, orip's name, original name) as text."""
    stream = io.StringIO()
    table = csv.writer(stream, lineterminator="\n")
    table.writerow(_HEADING)
    table.writerows(rows)
    return stream.getvalue()


def read_names(folder: Path) -> NamesTable:
    """Read the table of a project folder; rows that are not names are passed over, and so is a table that is absent.

    Raises
    ------
    InputError
        If a name has a character that cannot be printed: no other program has such names.
    """
    data, _ = read_bytes(folder / NAMES_FILE, NAMES_FILE, may_be_absent=True)
    found: dict[str, dict[str, str]] = {"camera": {}, "photo": {}, "point": {}, "track": {}}
    try:
        for line, row in enumerate(csv.reader((data or b"").decode("utf-8-sig").splitlines()), start=1):
            unfit = [word for word in row if has_hidden(word)]
            if unfit:
                message = f"'{shown_token(unfit[0])}' has a character that cannot be printed; correct the name"
                raise InputError.single(message, NAMES_FILE, line)
            if len(row) == len(_HEADING) and row[0] in found:
                found[row[0]][record_key(row[1]) if row[0] in _RECORDS else row[1]] = row[2]
    except (UnicodeDecodeError, csv.Error):
        return NamesTable()
    return NamesTable(found["camera"], found["photo"], found["point"], found["track"])


def place_from(folder: Path, source: Path) -> str:
    """Return the place of an original as it is written into a project folder."""
    try:
        place = os.path.relpath(source, folder)
    except ValueError:  # on another drive of Windows
        place = str(source.absolute())
    return place.replace(os.sep, "/")


def read_original(folder: Path) -> Original | None:
    """Read where a project folder was imported from; None where it does not say."""
    path = folder / SOURCE_FILE
    if path.is_file() and path.stat().st_size > _LARGEST_SOURCE_FILE:
        return None
    data, _ = read_bytes(path, SOURCE_FILE, may_be_absent=True)
    try:
        table = toml_document((data or b"").decode("utf-8")).get("source", {})
        return Original(table["format"], Path(os.path.normpath(folder / table["path"])))
    except (ValueError, KeyError, TypeError, AttributeError):
        return None
