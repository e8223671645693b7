"""Original names of cameras, photos and points: read, made fit, kept in a table."""

from __future__ import annotations

import csv
import io
import os
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path, PurePosixPath, PureWindowsPath

from msgspec import Struct, field

from orip.errors import InputError
from orip.files.project.toml_lines import toml_document
from orip.files.text.lines import read_bytes
from orip.files.text.shown import has_hidden, shown_token
from orip.records.exchanged import ExchangedPoints, ExchangedProject
from orip.records.names import COMMENT_MARKS, RESERVED_NAMES, record_key
from orip.structs import replace

# The place of the original is that from the project folder, so that both can be moved together.

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


_UNFIT = re.compile(r"[\s\x00-\x1f\x7f-\x9f]+")


def photo_names(names: Sequence[str]) -> tuple[str, ...]:
    """Return names of photo records: file names without folder and extension where these are different, else whole."""
    short = [_without_folder(name) for name in names]
    if len({record_key(name) for name in short}) == len(names):
        return unique_names(short, "photo", ignoring_case=True)
    return unique_names([name.replace("/", "_").replace("\\", "_") for name in names], "photo", ignoring_case=True)


def unique_names(names: Iterable[str], what: str, *, ignoring_case: bool, taken: Iterable[str] = ()) -> tuple[str, ...]:
    """Return names fit for orip, different from one another and from those taken.

    Blanks become ``_``; what still occurs twice gets a number. `what` stands for a name of which nothing is left.
    """
    keys = {record_key(name) if ignoring_case else name for name in taken}
    found = []
    for given in names:
        name = base = _fit_name(given) or what
        number = 1
        while (key := record_key(name) if ignoring_case else name) in keys:
            number += 1
            name = f"{base}_{number}"
        keys.add(key)
        found.append(name)
    return tuple(found)


def mark_names(names: Iterable[str]) -> dict[str, str]:
    """Return names of marks, which they keep where they can, by those that they have in another program."""
    given = list(dict.fromkeys(names))
    return dict(zip(given, unique_names(given, "point", ignoring_case=False), strict=True))


def point_names(points: ExchangedPoints, marks: Mapping[str, str]) -> tuple[str, ...]:
    """Return names of points: those of marks (`mark_names`), and of tracks T and their number, different from these."""
    is_track = points.is_track.tolist()
    numbers = [TRACK_MARK + name for name, track in zip(points.names, is_track, strict=True) if track]
    taken = set(marks.values())
    if not taken.isdisjoint(numbers) or len(set(numbers)) < len(numbers) or any(map(_UNFIT.search, numbers)):
        numbers = list(unique_names(numbers, "track", ignoring_case=False, taken=taken))
    tracks = iter(numbers)
    return tuple(next(tracks) if track else marks[name] for name, track in zip(points.names, is_track, strict=True))


def _without_folder(name: str) -> str:
    path = PureWindowsPath(name) if "\\" in name else PurePosixPath(name)
    return path.stem


def _fit_name(name: str) -> str:
    fit = _UNFIT.sub("_", name).lstrip("".join(COMMENT_MARKS))
    fit = "".join(character for character in fit if character.isprintable())
    return "" if fit in RESERVED_NAMES else fit


_HEADING_OF_NAMES = ("kind", "file", "original")


def distinct_names(points: ExchangedPoints, *, marks_tracks: bool = False) -> tuple[str, ...]:
    """Return names of points for files that have one kind of point: those of marks; a track that meets one has a T.

    Parameters
    ----------
    marks_tracks : bool
        All tracks have the T.
    """
    names = list(points.names)
    marks, tracks = points.marks, points.tracks
    changed = [name for name in tracks if marks_tracks or name in marks]
    taken = {*marks, *({} if marks_tracks else tracks)}
    for name in changed:
        found = TRACK_MARK + name
        while found in taken:
            found = TRACK_MARK + found
        taken.add(found)
        names[tracks[name]] = found
    return tuple(names)


def short_names(names: Sequence[str], suits: Callable[[str], bool], first: Sequence[int] = ()) -> list[str]:
    """Return names, different from one another: those that suit, and numbers for the others and for repeated ones.

    Those at the places `first` are kept before others.
    """
    taken: set[str] = set()
    kept = [False] * len(names)
    for place in dict.fromkeys([*first, *range(len(names))]):
        kept[place] = suits(names[place]) and names[place] not in taken
        taken.update([names[place]] if kept[place] else [])
    number = 0
    found = []
    for name, is_kept in zip(names, kept, strict=True):
        while not is_kept and (number == 0 or str(number) in taken):
            number += 1
        found.append(name if is_kept else str(number))
        taken.add(found[-1])
    return found


def with_original_names(project: ExchangedProject, folder: Path) -> ExchangedProject:
    """Return a project with the names that the table of a folder tells; a folder without one keeps its names."""
    table = read_names(folder)
    cameras = tuple(
        replace(camera, name=table.cameras.get(record_key(camera.name), camera.name)) for camera in project.cameras
    )
    photos = tuple(
        replace(photo, name=table.photos.get(record_key(photo.name), photo.name)) for photo in project.photos
    )
    known = {*project.points.marks, *(point.name for point in project.control)}
    marks = {name: table.original_mark(name) for name in known}
    if len(set(marks.values())) < len(marks):
        marks = {}
    names = tuple(
        name if is_track else marks.get(name, name)
        for name, is_track in zip(project.points.names, project.points.is_track.tolist(), strict=True)
    )
    control = tuple(replace(point, name=marks.get(point.name, point.name)) for point in project.control)
    return replace(
        project, cameras=cameras, photos=photos, points=replace(project.points, names=names), control=control
    )


def names_file(kinds: Iterable[tuple[str, Sequence[str], Sequence[str]]]) -> dict[str, bytes]:
    """Return a table of names that are not the original ones, of (kind, names, original names); nothing if all are."""
    stream = io.StringIO()
    rows = csv.writer(stream, lineterminator="\n")
    rows.writerow(_HEADING_OF_NAMES)
    changed = [
        (kind, name, original)
        for kind, names, originals in kinds
        for name, original in zip(names, originals, strict=True)
        if name != original
    ]
    rows.writerows(changed)
    return {NAMES_FILE: stream.getvalue().encode()} if changed else {}
