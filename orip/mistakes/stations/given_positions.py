"""The positions of photos as they are given, in .STA or in .ELE."""

from __future__ import annotations

import numpy as np
from msgspec import Struct

from orip.arrays import FloatArray
from orip.records.block import Block
from orip.records.names import record_key
from orip.records.photo import PHOTO_PARAMETERS

PLACES = PHOTO_PARAMETERS[:3]
"""X0, Y0, Z0."""


class GivenPositions(Struct, frozen=True):
    """n photos in the order of the project, their positions and errors (n, 3) in ground units, and the file."""

    photos: tuple[str, ...]
    given: FloatArray
    errors: FloatArray
    file: str


def given_positions(block: Block) -> GivenPositions:
    """Return the whole positions that are observed in the .STA file; without any, those of the .ELE file."""
    places = {
        record_key(station.photo): (station.position, station.position_error)
        for station in block.stations
        if station.has_position
    }
    file = ".STA" if places else ".ELE"
    places = places or _of_elements(block)
    photos = tuple(photo.name for photo in block.photos if record_key(photo.name) in places)
    both = np.array([places[record_key(name)] for name in photos], dtype=np.float64).reshape(-1, 2, 3)
    return GivenPositions(photos, both[:, 0], both[:, 1], file)


_Triple = tuple[float, float, float]


def _of_elements(block: Block) -> dict[str, tuple[_Triple, _Triple]]:
    values: dict[str, dict[str, tuple[float, float]]] = {}
    for element in block.elements:
        if element.group == "PHOTO" and element.kind in PLACES:
            values.setdefault(record_key(element.name), {})[element.kind] = (element.value, element.error)
    whole = {key: [of[kind] for kind in PLACES] for key, of in values.items() if len(of) == len(PLACES)}
    return {key: ((x[0], y[0], z[0]), (x[1], y[1], z[1])) for key, (x, y, z) in whole.items()}
