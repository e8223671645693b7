"""Names of other programs as orip's names: one word, records without regard to case."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import PurePosixPath, PureWindowsPath

from orip.records.exchanged import ExchangedPoints
from orip.records.names import COMMENT_MARKS, RESERVED_NAMES, record_key

TRACK_MARK = "T"
"""Stands before the number of a track, so that it meets no name of a control point."""

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
