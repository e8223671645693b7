"""Points and rays of a foreign project as they are found in its files, row by row."""

from __future__ import annotations

import math
from array import array
from collections.abc import Sequence

import numpy as np

from orip.arrays import FloatArray, IntArray
from orip.records.exchanged import ExchangedPoints, ExchangedRays

_UNKNOWN = (math.nan, math.nan, math.nan)


class CollectedPoints:
    """Points by name; a track and a point of the same name are two."""

    def __init__(self) -> None:
        self._place: dict[tuple[str, bool], int] = {}
        self._coordinates = array("d")

    def add(self, name: str, coordinates: Sequence[float] | None = None, *, is_track: bool = False) -> int:
        """Return the place of a point, which is added if it is new; coordinates are those given last."""
        known = len(self._place)
        place = self._place.setdefault((name, is_track), known)
        if place == known:
            self._coordinates.extend(_UNKNOWN)
        if coordinates is not None:
            self._coordinates[3 * place : 3 * place + 3] = array("d", coordinates)
        return place

    def place(self, name: str, *, is_track: bool = False) -> int | None:
        """Return the place of a point; None if there is no such point."""
        return self._place.get((name, is_track))

    def points(self) -> ExchangedPoints:
        """Return all points."""
        return ExchangedPoints(
            tuple(name for name, _ in self._place),
            np.array(self._coordinates, dtype=np.float64).reshape(-1, 3),
            np.array([is_track for _, is_track in self._place], dtype=bool),
        )


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
