"""The photo points of each camera."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from orip.arrays import IntArray
from orip.interior.definitions import Definitions
from orip.records.coded_names import coded
from orip.records.names import record_key
from orip.records.observations.measurement import PhotoObservations
from orip.records.project.photo import Photo


def rows_by_camera(
    definitions: Definitions, observations: PhotoObservations, is_meant: Callable[[Photo], bool]
) -> Mapping[str, IntArray]:
    """Return the rows of the observations by the `record_key` of their camera, of photos that meet a condition."""
    names = coded(observations.photos)
    keys: dict[str, int] = {}

    def camera(name: str) -> int:
        photo = definitions.photos.get(record_key(name))
        if photo is None or not is_meant(photo):
            return -1
        return keys.setdefault(record_key(photo.camera), len(keys))

    number = names.numbers(camera)
    return {key: np.flatnonzero(number == place) for key, place in keys.items()}
