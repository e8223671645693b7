"""The corrections of photos in a solution, found without looking at every unknown by its name."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from orip.arrays import FloatArray
from orip.bundle.unknowns import UnknownName
from orip.sequential.observation_rows import ReducedColumns

_ANGLES = ("OMEGA", "PHI", "KAPPA")


class PhotoCorrections:
    """The unknowns of photos among the reduced ones; they are looked up when some have been appended.

    Attributes
    ----------
    photos : list of str
        In the order of `largest`.
    """

    def __init__(self, columns: ReducedColumns) -> None:
        self.photos: list[str] = []
        self._columns = columns
        self._seen = 0
        self._rows: dict[str, int] = {}
        self._angles: tuple[list[int], list[int]] = ([], [])
        self._centres: tuple[list[int], list[int]] = ([], [])

    def of(self, names: Sequence[UnknownName], reduced: FloatArray) -> FloatArray:
        """Return the corrections (k,) of some unknowns; 0 of one that no equation has."""
        places = self._columns.known_places(names)
        return np.where(places < 0, 0.0, reduced[np.maximum(places, 0)]) if len(reduced) else np.zeros(len(names))

    def largest(self, reduced: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the largest correction of the angles and of the centre of each photo (number of photos,)."""
        self._look_up()
        return self._largest(self._angles, reduced), self._largest(self._centres, reduced)

    def _largest(self, found: tuple[list[int], list[int]], reduced: FloatArray) -> FloatArray:
        rows, places = (np.array(part, dtype=np.int64) for part in found)
        largest = np.zeros(len(self.photos))
        np.maximum.at(largest, rows, np.abs(reduced[places]))
        return largest

    def _look_up(self) -> None:
        for place, name in enumerate(self._columns.names[self._seen :], start=self._seen):
            if name.group != "PHOTO":
                continue
            if name.name not in self._rows:
                self._rows[name.name] = len(self.photos)
                self.photos.append(name.name)
            rows, places = self._angles if name.kind in _ANGLES else self._centres
            rows.append(self._rows[name.name])
            places.append(place)
        self._seen = len(self._columns.names)
