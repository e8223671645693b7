"""Tie points of MicMac: files of pairs of photos (``Homol/Pastis*``), and of several photos (``PMul*``)."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Protocol

import numpy as np
from msgspec import Struct

from orip.arrays import FloatArray
from orip.exchange.sources.text import Faults, text_lines
from orip.files.text.lines import read_bytes
from orip.files.text.shown import shown_token

# A pair has column and row in the first photo and in the second one: a line of a text; in a binary file (little endian)
# after the number 2 (4 bytes) and a weight (8 bytes), and after a head of 8 bytes, 2 and the number of pairs. The same
# feature has the same coordinates in all files of its photo.

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
    for number, line in enumerate(text_lines(path, faults), start=1):
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


# A head ends in ``EndHeader``. Then come the number of attributes of a point, the number of photos with lines
# ``NAME=number``, and the number of configurations. A configuration has the numbers of its points and photos, the
# numbers of these photos, and for each point a column and a row in each of them and its attributes. Texts have comments
# after ``#``; the binary form has none, 4 bytes for a whole number and 8 for a decimal one, little endian.

_BEGIN, _END = b"BeginHeader-MicMacTiePointFormat", b"EndHeader"
_COMMENT = b"#"
_LONGEST_LINE = 4096
_MOST_ATTRIBUTES = 100


class _DamagedError(Exception):
    """The file does not have what its counts say."""


class _Numbers(Protocol):
    """What is left of a file."""

    def whole(self, most: int) -> int: ...

    def decimals(self, count: int) -> FloatArray: ...

    def line(self) -> bytes: ...


class _Binary(Struct):
    data: bytes
    place: int

    def whole(self, most: int) -> int:
        value = int.from_bytes(self._taken(4), "little")
        if value > most:
            message = f"byte {self.place - 4}: {value} is more than the file has room for"
            raise _DamagedError(message)
        return value

    def decimals(self, count: int) -> FloatArray:
        return np.frombuffer(self._taken(8 * count), dtype="<f8")

    def line(self) -> bytes:
        end = self.data.find(b"\n", self.place, self.place + _LONGEST_LINE)
        if end < 0:
            message = f"byte {self.place}: a line with the name of a photo should be here"
            raise _DamagedError(message)
        found, self.place = self.data[self.place : end], end + 1
        return found.strip()

    def _taken(self, count: int) -> bytes:
        if count > len(self.data) - self.place:
            message = f"byte {self.place}: the file ends before {count} bytes more"
            raise _DamagedError(message)
        self.place += count
        return self.data[self.place - count : self.place]


class _Text(Struct):
    lines: list[bytes]
    place: int
    words: list[bytes]

    def whole(self, most: int) -> int:
        word = self._taken(1)[0]
        if not word.isdigit() or len(word) > 10 or int(word) > most:
            message = f"line {self.place}: '{shown_token(word.decode(errors='replace'))}' is not a number up to {most}"
            raise _DamagedError(message)
        return int(word)

    def decimals(self, count: int) -> FloatArray:
        words = self._taken(count)
        try:
            return np.array([float(word) for word in words])
        except ValueError:
            message = f"line {self.place}: a word is not a number"
            raise _DamagedError(message) from None

    def line(self) -> bytes:
        self.words = []
        while not (found := self._next_line()):
            pass
        return found

    def _taken(self, count: int) -> list[bytes]:
        while len(self.words) < count:
            self.words += self._next_line().split()
        found, self.words = self.words[:count], self.words[count:]
        return found

    def _next_line(self) -> bytes:
        if self.place >= len(self.lines):
            message = f"line {self.place}: the file ends before its last point"
            raise _DamagedError(message)
        self.place += 1
        return self.lines[self.place - 1].partition(_COMMENT)[0].strip()


def multiple_tie_files(homol: Path) -> list[Path]:
    """Return the files of tie points in several photos, the binary one where there are two of a name."""
    found = {path.stem: path for kind in ("txt", "dat") for path in homol.glob(f"*PMul*.{kind}")}
    return [found[stem] for stem in sorted(found)]


def read_multiple_ties(path: Path, photos: dict[str, int], joiner: TrackJoiner, faults: Faults) -> None:
    """Read a file of tie points and join the features of each.

    Parameters
    ----------
    photos : dict of str to int
        Places of the photos that are wanted.
    faults : Faults
        Takes the complaints.
    """
    is_text = path.suffix.lower() == ".txt"
    if is_text:
        data: bytes | None = "\n".join(text_lines(path, faults)).encode()
    else:
        data, complaints = read_bytes(path, faults.shown)
        faults.complaints += complaints
    if data is None:
        return
    end = data.find(_END + b"\n", 0, _LONGEST_LINE)
    if not data.startswith(_BEGIN) or end < 0:
        faults.complain("this is not a file of tie points of MicMac; write it again", 1)
        return
    begin = end + len(_END) + 1
    numbers: _Numbers = _Binary(data, begin)
    if is_text:
        numbers = _Text(data.split(b"\n"), data.count(b"\n", 0, begin), [])
    try:
        for pixels, places in _points(numbers, photos, len(data)):
            features = [joiner.feature(place, *pixel) for place, pixel in zip(places, pixels, strict=True)]
            for feature in features[1:]:
                joiner.join(features[0], feature)
    except _DamagedError as fault:
        faults.complain(f"{fault}; write the file again")


def _points(
    numbers: _Numbers, photos: dict[str, int], size: int
) -> Iterator[tuple[list[tuple[float, float]], list[int]]]:
    """Yield the pixels of each point and the places of its photos, of those photos that are wanted."""
    attributes, count = numbers.whole(_MOST_ATTRIBUTES), numbers.whole(size)
    names = [_name(numbers.line()) for _ in range(count)]
    for _ in range(numbers.whole(size)):
        points, shown = numbers.whole(size), numbers.whole(count)
        if shown < 1:
            message = "points in no photo are announced"
            raise _DamagedError(message)
        places = [photos.get(names[numbers.whole(count - 1)], -1) for _ in range(shown)]
        wanted = [n for n, place in enumerate(places) if place >= 0]
        for _ in range(points):
            values = numbers.decimals(2 * shown + attributes)
            pixels = values[: 2 * shown].reshape(-1, 2)
            if not (np.abs(pixels) < _FARTHEST).all():
                message = "a column or row is not in a photo"
                raise _DamagedError(message)
            if len(wanted) > 1:
                yield [(float(pixels[n, 0]), float(pixels[n, 1])) for n in wanted], [places[n] for n in wanted]


def _name(line: bytes) -> str:
    return line.rpartition(b"=")[0].decode("utf-8", errors="replace")
