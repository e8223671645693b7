"""Tracks of OpenSfM (``tracks.csv``): which feature of a photo belongs to which track, in all versions of the file.

Columns are separated by tabs. Version 0 has no head and no scale; version 1 adds the scale of the feature, version 2
the segmentation and the instance. The coordinates are normalised: from the centre of the photo, divided by its longer
side, y down.
"""

from __future__ import annotations

import math
from array import array
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from orip.arrays import FloatArray, IntArray
from orip.exchange.sources.faults import Faults
from orip.files.text.lines import read_lines
from orip.files.text.shown import shown_token

_HEAD = "OPENSFM_TRACKS_VERSION_v"
_FIELDS = {0: 8, 1: 9, 2: 11}
_FARTHEST = 10.0
"""Normalised coordinate that no camera has; the corners of a photo are at 0.7."""
_LARGEST_FEATURE = 1 << 31
_LINES_AT_ONCE = 50_000
_SHOT, _TRACK, _FEATURE, _X, _Y = range(5)


@dataclass(frozen=True, slots=True)
class Tracks:
    """Features of photos that belong to tracks.

    Parameters
    ----------
    shots : tuple of str
        Names of the photos.
    tracks : tuple of str
        Names of the tracks.
    shot, track, feature : int array, shape (n,)
        Of each feature: indices of its photo and of its track, and its number in the photo.
    coordinates : float array, shape (n, 2)
        Normalised x (right) and y (down).
    line : int array, shape (n,)
        Its line in the file.
    """

    shots: tuple[str, ...]
    tracks: tuple[str, ...]
    shot: IntArray
    track: IntArray
    feature: IntArray
    coordinates: FloatArray
    line: IntArray


def read_tracks(path: Path, faults: Faults) -> Tracks:
    """Read a file of tracks; what is wrong with it is kept with its line."""
    lines = read_lines(path, faults.shown)
    faults.complaints += lines.complaints
    first = lines.value[0] if lines.value else ""
    fields = _fields_of_version(first, faults)
    begin = 1 if first.startswith(_HEAD) else 0
    found = _Gathered()
    for place in range(begin, len(lines.value), _LINES_AT_ONCE):
        several = lines.value[place : place + _LINES_AT_ONCE]
        if not found.add_sound(several, place + 1, fields):
            for number, line in enumerate(several, start=place + 1):
                if line.strip():
                    found.add_line(line, number, fields, faults)
    return found.tracks()


class _Gathered:
    """Rows of the file, as they are read."""

    def __init__(self) -> None:
        self._shots: dict[str, int] = {}
        self._tracks: dict[str, int] = {}
        self._indices, self._coordinates = array("q"), array("d")

    def add_sound(self, lines: list[str], number: int, fields: int) -> bool:
        """Add lines that have no fault, from a line number on; return False, and add none, if one may have some."""
        if any(line.count("\t") != fields - 1 for line in lines):
            return False
        words = "\t".join(lines).split("\t")
        try:
            feature = np.array(list(map(int, words[_FEATURE::fields])), dtype=np.int64)
            places = np.array([list(map(float, words[_X::fields])), list(map(float, words[_Y::fields]))])
        except (ValueError, OverflowError):
            return False
        if not ((feature >= 0) & (feature < _LARGEST_FEATURE) & (np.abs(places) <= _FARTHEST).all(axis=0)).all():
            return False
        count = len(lines)
        shots = _places_of(words[_SHOT::fields], self._shots)
        tracks = _places_of(words[_TRACK::fields], self._tracks)
        rows = [shots, tracks, feature, np.arange(number, number + count)]
        self._indices.frombytes(np.ascontiguousarray(np.stack(rows, axis=1), dtype=np.int64).tobytes())
        self._coordinates.frombytes(np.ascontiguousarray(places.T).tobytes())
        return True

    def add_line(self, line: str, number: int, fields: int, faults: Faults) -> None:
        """Add a line; what is wrong with it is kept."""
        row = _row(line, number, fields, faults)
        if row is not None:
            shot, track, feature, x, y = row
            places = (self._shots.setdefault(shot, len(self._shots)), self._tracks.setdefault(track, len(self._tracks)))
            self._indices.extend((*places, feature, number))
            self._coordinates.extend((x, y))

    def tracks(self) -> Tracks:
        """Return what was added."""
        columns = np.frombuffer(self._indices, dtype=np.int64).reshape(-1, 4).T
        places = np.frombuffer(self._coordinates, dtype=float).reshape(-1, 2)
        shots, tracks = tuple(self._shots), tuple(self._tracks)
        return Tracks(shots, tracks, columns[0], columns[1], columns[2], places, columns[3])


def _places_of(names: list[str], known: dict[str, int]) -> IntArray:
    """Return the places of names, those that are not known being added."""
    for name in dict.fromkeys(names):
        known.setdefault(name, len(known))
    return np.fromiter(map(known.__getitem__, names), dtype=np.int64, count=len(names))


def _fields_of_version(first: str, faults: Faults) -> int:
    if not first.startswith(_HEAD):
        return _FIELDS[0]
    version = first.removeprefix(_HEAD).strip()
    if version not in {str(known) for known in _FIELDS}:
        faults.complain(f"version '{version}' of tracks is not known; those known are 0, 1 and 2", 1)
        return _FIELDS[2]
    return _FIELDS[int(version)]


def _row(line: str, number: int, fields: int, faults: Faults) -> tuple[str, str, int, float, float] | None:
    found = line.count("\t") + 1
    if found != fields:
        form = "photo, track, feature, x, y and others, separated by tabs"
        faults.complain(f"{found} fields, and {fields} should be here: {form}", number)
        return None
    words = line.split("\t", _Y + 1)
    try:
        feature, x, y = int(words[_FEATURE]), float(words[_X]), float(words[_Y])
    except ValueError:
        feature, x, y = -1, math.nan, math.nan
    if 0 <= feature < _LARGEST_FEATURE and abs(x) <= _FARTHEST and abs(y) <= _FARTHEST:
        return words[_SHOT], words[_TRACK], feature, x, y
    faults.complain(
        "feature, x and y should be a whole number and two normalised coordinates, found "
        f"'{shown_token(' '.join(words[_FEATURE : _Y + 1]))}'; correct them",
        number,
    )
    return None
