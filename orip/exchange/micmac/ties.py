"""Tie points of MicMac: files of pairs (``Homol/PastisPHOTO1/PHOTO2.txt``), joined to tracks.

A line has column and row in the first photo and in the second one. The same feature has the same coordinates in all
files of its photo.
"""

from __future__ import annotations

from pathlib import Path

from orip.exchange.sources.faults import Faults
from orip.files.text.lines import read_lines

_FOLDER = "Pastis"
_STEPS_PER_PIXEL = 100
"""Coordinates are printed with more digits than a feature is located; equal to a hundredth of a pixel is equal."""

Feature = tuple[int, int, int]
"""Photo, and column and row in hundredths of a pixel."""


def pair_files(homol: Path) -> list[tuple[str, str, Path]]:
    """Return the text files of pairs in a folder ``Homol``: first photo, second photo, path."""
    found = []
    for folder in sorted(path for path in homol.glob(f"{_FOLDER}*") if path.is_dir()):
        first = folder.name.removeprefix(_FOLDER)
        found += [(first, path.name.removesuffix(".txt"), path) for path in sorted(folder.glob("*.txt"))]
    return found


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
    lines = read_lines(path, faults.shown)
    faults.complaints += lines.complaints
    for number, line in enumerate(lines.value, start=1):
        if not line.strip():
            continue
        values = faults.decimals(line, 4, "column and row in both photos", number)
        if values is not None:
            joiner.join(joiner.feature(photos[0], *values[:2]), joiner.feature(photos[1], *values[2:]))
