"""Tie points of MicMac: files of pairs (``Homol/PastisPHOTO1/PHOTO2.dat`` or ``.txt``), joined to tracks.

A pair has column and row in the first photo and in the second one: a line of a text; in a binary file (little endian)
after the number 2 (4 bytes) and a weight (8 bytes), and after a head of 8 bytes, 2 and the number of pairs. The same
feature has the same coordinates in all files of its photo.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from orip.exchange.sources.faults import Faults
from orip.files.text.lines import read_bytes, read_lines

_FOLDER = "Pastis"
_STEPS_PER_PIXEL = 100
"""Coordinates are printed with more digits than a feature is located; equal to a hundredth of a pixel is equal."""

Feature = tuple[int, int, int]
"""Photo, and column and row in hundredths of a pixel."""


_IN_PAIR = 2
_FARTHEST = 1e7
"""Pixels that no photo has."""

_BINARY_HEAD = np.dtype([("dimension", "<i4"), ("count", "<i4")])
_BINARY_PAIR = np.dtype([("photos", "<i4"), ("weight", "<f8"), ("pixels", "<f8", (4,))])


def pair_files(homol: Path) -> list[tuple[str, str, Path]]:
    """Return the files of pairs in a folder ``Homol``: first photo, second photo, path; binary where there are two."""
    found: dict[tuple[str, str], Path] = {}
    for folder in sorted(path for path in homol.glob(f"{_FOLDER}*") if path.is_dir()):
        first = folder.name.removeprefix(_FOLDER)
        for suffix in (".txt", ".dat"):
            found |= {(first, path.name.removesuffix(suffix)): path for path in sorted(folder.glob(f"*{suffix}"))}
    return [(first, second, path) for (first, second), path in found.items()]


class TrackJoiner:
    """Joins features that correspond to tracks."""

    def __init__(self) -> None:
        self._parent: dict[Feature, Feature] = {}
        self._place: dict[Feature, tuple[float, float]] = {}

    def root(self, feature: Feature) -> Feature:
        """Return the feature that stands for the track of a feature."""
        parent = self._parent.setdefault(feature, feature)
        while parent != feature:
            grandparent = self._parent[parent]
            self._parent[feature] = grandparent
            feature, parent = parent, grandparent
        return feature

    def feature(self, photo: int, column: float, row: float) -> Feature:
        """Return the feature of a place; its coordinates are those of the first file that has it."""
        feature = (photo, round(column * _STEPS_PER_PIXEL), round(row * _STEPS_PER_PIXEL))
        self._place.setdefault(feature, (column, row))
        return feature

    def join(self, first: Feature, second: Feature) -> None:
        """Join the tracks of two features that correspond."""
        self._parent[self.root(second)] = self.root(first)

    def __bool__(self) -> bool:
        return bool(self._parent)

    def tracks(self) -> list[list[tuple[int, float, float]]]:
        """Return photo, column and row of the features of each track, in the order in which they were found."""
        groups: dict[Feature, list[tuple[int, float, float]]] = {}
        for feature in self._parent:
            groups.setdefault(self.root(feature), []).append((feature[0], *self._place[feature]))
        return list(groups.values())


def read_pairs(path: Path, photos: tuple[int, int], joiner: TrackJoiner, faults: Faults) -> None:
    """Read a file of pairs and join them."""
    if path.suffix.lower() == ".dat":
        _read_binary(path, photos, joiner, faults)
        return
    lines = read_lines(path, faults.shown)
    faults.complaints += lines.complaints
    for number, line in enumerate(lines.value, start=1):
        if not line.strip():
            continue
        values = faults.decimals(line, 4, "column and row in both photos", number)
        if values is not None:
            joiner.join(joiner.feature(photos[0], *values[:2]), joiner.feature(photos[1], *values[2:]))


def _read_binary(path: Path, photos: tuple[int, int], joiner: TrackJoiner, faults: Faults) -> None:
    data, complaints = read_bytes(path, faults.shown)
    faults.complaints += complaints
    if data is None:
        return
    if len(data) < _BINARY_HEAD.itemsize:
        faults.complain("the file ends before byte 8; write it again")
        return
    dimension, count = (int(value) for value in np.frombuffer(data, dtype=_BINARY_HEAD, count=1)[0])
    room = (len(data) - _BINARY_HEAD.itemsize) // _BINARY_PAIR.itemsize
    if dimension != _IN_PAIR or not 0 <= count <= room:
        faults.complain(
            f"{count} points in {dimension} photos are announced (bytes 0 to 7), and there is room for {room} pairs; "
            "write the file again"
        )
        return
    pairs = np.frombuffer(data, dtype=_BINARY_PAIR, count=count, offset=_BINARY_HEAD.itemsize)
    is_sound = (pairs["photos"] == _IN_PAIR) & (np.abs(pairs["pixels"]) < _FARTHEST).all(axis=1)
    if not is_sound.all():
        byte = _BINARY_HEAD.itemsize + _BINARY_PAIR.itemsize * int(np.flatnonzero(~is_sound)[0])
        faults.complain(f"byte {byte}: this is not a pair of pixels; write the file again")
        return
    for first_x, first_y, second_x, second_y in pairs["pixels"].tolist():
        joiner.join(joiner.feature(photos[0], first_x, first_y), joiner.feature(photos[1], second_x, second_y))
