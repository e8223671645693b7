"""Names for formats that have only short ones, or numbers: kept where they suit, else numbers, told in a table."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

from orip.exchange.names_table import NAMES_FILE, TRACK_MARK, read_names
from orip.records.exchanged import ExchangedPoints, ExchangedProject
from orip.records.names import record_key
from orip.structs import replace

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
