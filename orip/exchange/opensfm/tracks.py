"""Tracks of OpenSfM (``tracks.csv``), which feature belongs to which, and how precise its settings say they are."""

from __future__ import annotations

import math
import re
from array import array
from collections.abc import Mapping, Sequence
from itertools import repeat
from pathlib import Path

import numpy as np
from msgspec import Struct

from orip.arrays import FloatArray, IntArray
from orip.exchange.sources.text import Faults, text_lines
from orip.files.text.shown import shown_token

_SIZE = re.compile(r"\s*feature_process_size\s*:\s*([0-9]{2,6})\b")
_HELD = re.compile(r"\s*optimize_camera_parameters\s*:\s*(no|false|off)\b", re.IGNORECASE)


class Settings(Struct, frozen=True):
    """Settings.

    Parameters
    ----------
    feature_size : int or None
        Larger side of the images in which features were found; None where the file does not say it.
    holds_cameras : bool
        OpenSfM was told not to estimate cameras.
    """

    feature_size: int | None = None
    holds_cameras: bool = False

    def feature_precision(self, larger_side: int) -> float | None:
        """Return the a-priori error of a feature in pixels of the original image: a pixel of the one it was found in.

        1 where images were not made smaller; None where the settings do not say.
        """
        return None if self.feature_size is None else max(1.0, larger_side / self.feature_size)


def read_settings(config: Path, faults: Faults) -> Settings:
    """Return what a ``config.yaml`` says."""
    size: int | None = None
    holds = False
    for line in text_lines(config, faults):
        if size is None and (found := _SIZE.match(line)):
            size = int(found[1])
        holds = holds or _HELD.match(line) is not None
    return Settings(size, holds)


# Columns are separated by tabs. Version 0 has no head and no scale; version 1 adds the scale of the feature, version 2
# the segmentation and the instance. The coordinates are normalised: from the centre of the photo, divided by its longer
# side, y down.

_HEAD = "OPENSFM_TRACKS_VERSION_v"
_FIELDS = {0: 8, 1: 9, 2: 11}
_FARTHEST = 10.0
"""Normalised coordinate that no camera has; the corners of a photo are at 0.7."""
_LARGEST_FEATURE = 1 << 31
_MOST_DIGITS = 9
"""Of the number of a feature that is read without looking at it."""
_LINES_AT_ONCE = 5_000
"""The words of more do not stay in the processor's cache."""
_SHOT, _TRACK, _FEATURE, _X, _Y = range(5)


class Features(Struct, frozen=True):
    """Features of photos that belong to tracks, n of them.

    Parameters
    ----------
    photo, point : int array, shape (n,)
        Places of the photo and of the track's point; -1 where it has none.
    coordinates : float array, shape (n, 2)
        Normalised x (right) and y (down).
    """

    photo: IntArray
    point: IntArray
    coordinates: FloatArray


def read_features(path: Path, faults: Faults, photos: Mapping[str, int], points: Mapping[str, int]) -> Features:
    """Read a file of tracks; what is wrong with it is kept with its line.

    Parameters
    ----------
    photos, points : mapping of str to int
        Places by the names of photos and of tracks.
    """
    lines = text_lines(path, faults)
    while lines and not lines[-1].strip():
        lines.pop()
    first = lines[0] if lines else ""
    fields = _fields_of_version(first, faults)
    begin = 1 if first.startswith(_HEAD) else 0
    found = _Gathered(photos, points)
    for place in range(begin, len(lines), _LINES_AT_ONCE):
        several = lines[place : place + _LINES_AT_ONCE]
        if not found.add_sound(several, fields):
            for number, line in enumerate(several, start=place + 1):
                if line.strip():
                    found.add_line(line, number, fields, faults)
    return found.features()


class _Gathered:
    """Rows of the file, as they are read."""

    def __init__(self, photos: Mapping[str, int], points: Mapping[str, int]) -> None:
        self._photos, self._points = photos, points
        self._places, self._coordinates = array("q"), array("d")

    def add_sound(self, lines: list[str], fields: int) -> bool:
        """Add lines that have no fault; return False, and add none, if one may have some."""
        if set(map(str.count, lines, repeat("\t"))) != {fields - 1}:
            return False
        words = "\t".join(lines).split("\t")
        features = words[_FEATURE::fields]
        if not all(map(str.isdigit, features)) or max(map(len, features)) > _MOST_DIGITS:
            return False
        try:
            places = np.stack([_decimals(words[column::fields]) for column in (_X, _Y)], axis=1)
        except ValueError:
            return False
        if not (np.abs(places) <= _FARTHEST).all():
            return False
        found = [_places_of(words[_SHOT::fields], self._photos), _places_of(words[_TRACK::fields], self._points)]
        self._places.frombytes(np.ascontiguousarray(np.stack(found, axis=1)).tobytes())
        self._coordinates.frombytes(places.tobytes())
        return True

    def add_line(self, line: str, number: int, fields: int, faults: Faults) -> None:
        """Add a line; what is wrong with it is kept."""
        row = _row(line, number, fields, faults)
        if row is not None:
            shot, track, x, y = row
            self._places.extend((self._photos.get(shot, -1), self._points.get(track, -1)))
            self._coordinates.extend((x, y))

    def features(self) -> Features:
        """Return what was added."""
        columns = np.frombuffer(self._places, dtype=np.int64).reshape(-1, 2).T
        return Features(columns[0], columns[1], np.frombuffer(self._coordinates, dtype=float).reshape(-1, 2))


def _decimals(words: Sequence[str]) -> FloatArray:
    return np.fromiter(map(float, words), dtype=np.float64, count=len(words))


def _places_of(names: Sequence[str], known: Mapping[str, int]) -> IntArray:
    """Return the places of names; -1 for those that have none."""
    return np.fromiter(map(known.get, names, repeat(-1)), dtype=np.int64, count=len(names))


def _fields_of_version(first: str, faults: Faults) -> int:
    if not first.startswith(_HEAD):
        return _FIELDS[0]
    version = first.removeprefix(_HEAD).strip()
    if version not in {str(known) for known in _FIELDS}:
        faults.complain(f"version '{version}' of tracks is not known; those known are 0, 1 and 2", 1)
        return _FIELDS[2]
    return _FIELDS[int(version)]


def _row(line: str, number: int, fields: int, faults: Faults) -> tuple[str, str, float, float] | None:
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
        return words[_SHOT], words[_TRACK], x, y
    faults.complain(
        "feature, x and y should be a whole number and two normalised coordinates, found "
        f"'{shown_token(' '.join(words[_FEATURE : _Y + 1]))}'; correct them",
        number,
    )
    return None
