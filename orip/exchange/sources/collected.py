"""Points and rays of a foreign project as they are found in its files, row by row or point by point."""

from __future__ import annotations

import math
from array import array
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import chain
from typing import NamedTuple, TypeVar

import numpy as np

from orip.arrays import FloatArray, IntArray
from orip.records.exchanged import ExchangedPoints, ExchangedProject, ExchangedRays
from orip.wording import counted, first_names

T = TypeVar("T")

_ENDINGS = {"jpg": "jpg", "jpeg": "jpg", "tif": "tif", "tiff": "tif", "png": "png", "dng": "dng"}
"""Endings of pictures, and one of each kind: a camera writes photos of one name in several kinds."""


def tracks(project: ExchangedProject) -> Iterator[tuple[int, IntArray]]:
    """Iterate over the places of points with coordinates and the rows of their rays, those that are left out aside."""
    rays = project.rays
    rows = np.flatnonzero(rays.is_active)
    rows = rows[np.argsort(rays.point[rows], kind="stable")]
    borders = np.searchsorted(rays.point[rows], np.arange(len(project.points.names) + 1))
    known = np.isfinite(project.points.coordinates).all(axis=1)
    for place in np.flatnonzero(known).tolist():
        yield place, rows[borders[place] : borders[place + 1]]


def places_in_photos(project: ExchangedProject) -> IntArray:
    """Return the place (k,) of each ray among the rays of its photo, counted from 0."""
    photo = project.rays.photo
    order = np.argsort(photo, kind="stable")
    first = np.searchsorted(photo[order], photo[order])
    found = np.empty(len(photo), dtype=np.int64)
    found[order] = np.arange(len(photo)) - first
    return found


def together(groups: Iterable[Sequence[T]]) -> list[list[T]]:
    """Return what was ever in one group with something else, those that hang together as one list; others are in none.

    Cameras of a rig in files that name no rigs are such: those that took photos at the same instant.
    """
    found: list[list[T]] = []
    for group in groups:
        own = list(dict.fromkeys(group))
        if len(own) < 2:
            continue
        touched = [one for one in found if any(item in one for item in own)]
        merged = list(dict.fromkeys([item for one in touched for item in one] + own))
        found = [one for one in found if one not in touched] + [merged]
    return found


_FIRST = 3
"""Names of a list that are told."""

_UNKNOWN = (math.nan, math.nan, math.nan)


class CollectedPoints:
    """Points by name; a track and a point of the same name are two."""

    def __init__(self) -> None:
        self._tracks: dict[str, int] = {}
        self._others: dict[str, int] = {}
        self._coordinates = array("d")

    @property
    def tracks(self) -> Mapping[str, int]:
        """Return the places of tracks by their names."""
        return self._tracks

    def add(self, name: str, coordinates: Sequence[float] | None = None, *, is_track: bool = False) -> int:
        """Return the place of a point, which is added if it is new; coordinates are those given last."""
        known = len(self._tracks) + len(self._others)
        place = (self._tracks if is_track else self._others).setdefault(name, known)
        if place == known:
            self._coordinates.extend(_UNKNOWN)
        if coordinates is not None:
            self._coordinates[3 * place : 3 * place + 3] = array("d", coordinates)
        return place

    def add_tracks(self, coordinates: Mapping[str, Sequence[float]]) -> None:
        """Add tracks with their coordinates, where there are no points yet."""
        if self._tracks or self._others:
            message = "there are points already"
            raise ValueError(message)
        self._tracks = dict(zip(coordinates, range(len(coordinates)), strict=True))
        self._coordinates = array("d", chain.from_iterable(coordinates.values()))

    def place(self, name: str, *, is_track: bool = False) -> int | None:
        """Return the place of a point; None if there is no such point."""
        return (self._tracks if is_track else self._others).get(name)

    def points(self) -> ExchangedPoints:
        """Return all points."""
        names = [""] * (len(self._tracks) + len(self._others))
        is_track = np.zeros(len(names), dtype=bool)
        is_track[np.fromiter(self._tracks.values(), dtype=np.int64, count=len(self._tracks))] = True
        for known in (self._tracks, self._others):
            for name, place in known.items():
                names[place] = name
        return ExchangedPoints(tuple(names), np.array(self._coordinates, dtype=np.float64).reshape(-1, 3), is_track)


class _Spelling(NamedTuple):
    """The parts of a photo's name in small letters: "" for a folder, or the ending of a picture, that it lacks."""

    folder: str
    stem: str
    ending: str

    @classmethod
    def of(cls, name: str) -> _Spelling:
        folder, _, file = name.replace("\\", "/").casefold().rpartition("/")
        stem, _, ending = file.rpartition(".")
        return cls(folder, stem, _ENDINGS[ending]) if stem and ending in _ENDINGS else cls(folder, file, "")

    def may_be(self, other: _Spelling) -> bool:
        """Return whether both may name one photo: what one of them lacks is no difference."""
        folders, endings = f"/{self.folder}", f"/{other.folder}"
        is_inside = folders.endswith(endings) or endings.endswith(folders) or not (self.folder and other.folder)
        return is_inside and (self.ending == other.ending or not (self.ending and other.ending))


class PhotoNames:
    """The photos of a project, as other files name them: in the same letters, or in others where these leave no doubt.

    Parameters
    ----------
    names : sequence of str
        Of the photos, in their order.
    """

    def __init__(self, names: Iterable[str]) -> None:
        self._places = {name: place for place, name in enumerate(names)}
        self._by_stem: dict[str, list[str]] = {}
        for name in self._places:
            self._by_stem.setdefault(_Spelling.of(name).stem, []).append(name)
        self._otherwise: Counter[str] = Counter()
        self._unknown: Counter[str] = Counter()

    def place(self, name: str) -> int | None:
        """Return the place of the photo that a row of another file belongs to; None, and remembered, if there is none.

        Upper and lower case, and a folder or an ending that only one of the two names has, make no difference where
        only one photo is meant.
        """
        place = self._places.get(name)
        if place is None:
            similar = self._similar(name)
            place = self._places[similar[0]] if len(similar) == 1 else None
            (self._unknown if place is None else self._otherwise)[name] += 1
        return place

    def _similar(self, name: str) -> list[str]:
        """Return the photos that a name may mean: those that differ in upper and lower case alone, or all."""
        spelling = _Spelling.of(name)
        found = [other for other in self._by_stem.get(spelling.stem, ()) if spelling.may_be(_Spelling.of(other))]
        return [other for other in found if other.casefold() == name.casefold()] or found

    def notes(self, file: str, noun: str, fate: str = "left out") -> list[str]:
        """Return what was not asked for by its exact name: counts of `noun`, what becomes of them, the first names."""
        notes = []
        if self._otherwise:
            first = min(self._otherwise)
            (meant,) = self._similar(first)
            parts = "upper and lower case" if meant.casefold() == first.casefold() else "case, folder and ending"
            notes.append(
                f"{counted(len(self._otherwise), 'photo')} of {file} matched without regard to {parts}: "
                f"{first} is {meant}."
            )
        if self._unknown:
            lost = counted(self._unknown.total(), noun)
            doubtful = any(self._similar(name) for name in self._unknown)
            why = "no photo or, in other upper and lower case, several have" if doubtful else "no oriented photo has"
            notes.append(
                f"{lost} of {file} {fate}, as {why} the names there: "
                f"{first_names(sorted(self._unknown)[:_FIRST], _FIRST, len(self._unknown))}."
            )
        return notes


class CollectedRays:
    """Rays in the order in which they are found."""

    def __init__(self) -> None:
        self._places = array("q")
        self._image = array("d")
        self._active = array("b")

    def __len__(self) -> int:
        return len(self._active)

    def add(
        self, photo: int, point: int, image: Sequence[float], deviation: float = math.nan, *, is_active: bool = True
    ) -> None:
        """Add a measurement of a point in a photo."""
        self._places.extend((photo, point))
        self._image.extend((image[0], image[1], deviation))
        self._active.append(is_active)

    def extend(self, photo: IntArray, point: IntArray, image: FloatArray) -> None:
        """Add n measurements: places (n,) of photos and points, image coordinates (n, 2); no deviations."""
        count = len(photo)
        self._places.frombytes(np.column_stack([photo, point]).astype(np.int64).tobytes())
        self._image.frombytes(np.column_stack([image, np.full(count, math.nan)]).astype(np.float64).tobytes())
        self._active.frombytes(np.ones(count, dtype=np.int8).tobytes())

    def rays(self) -> ExchangedRays:
        """Return all rays."""
        places = np.array(self._places, dtype=np.int64).reshape(-1, 2)
        image = np.array(self._image, dtype=np.float64).reshape(-1, 3)
        return ExchangedRays(
            places[:, 0], places[:, 1], image[:, :2], image[:, 2], np.array(self._active, dtype=np.int8).astype(bool)
        )
