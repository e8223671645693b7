"""Names of other programs as orip's names, and orip's names for formats that have only short ones, or numbers."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path, PurePosixPath, PureWindowsPath

from orip.exchange.sources.names_table import NAMES_FILE, TRACK_MARK, read_names
from orip.records.exchanged import ExchangedPoints, ExchangedProject
from orip.records.names import COMMENT_MARKS, RESERVED_NAMES, record_key
from orip.structs import replace

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


_HEADING = ("kind", "file", "original")


def distinct_names(points: ExchangedPoints, *, marks_tracks: bool = False) -> tuple[str, ...]:
    """Return names of points for files that have one kind of point: those of marks; a track that meets one has a T.

    Parameters
    ----------
    points : ExchangedPoints
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
    rows.writerow(_HEADING)
    changed = [
        (kind, name, original)
        for kind, names, originals in kinds
        for name, original in zip(names, originals, strict=True)
        if name != original
    ]
    rows.writerows(changed)
    return {NAMES_FILE: stream.getvalue().encode()} if changed else {}
