"""The photo points of each camera, for the checks of what is measured with it."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from orip.arrays import IntArray
from orip.interior.definitions import Definitions
from orip.records.coded_names import coded
from orip.records.names import record_key
from orip.records.observations.measurement import PhotoObservations
from orip.records.project.camera import Camera
from orip.records.project.photo import Photo


def points_of_cameras(
    definitions: Definitions, observations: PhotoObservations, concerned: Callable[[Photo], bool]
) -> Iterator[tuple[Camera, IntArray]]:
    """Yield each camera with the rows of the photo points that are measured in its photos.

    Parameters
    ----------
    definitions : Definitions
    observations : PhotoObservations
        Of one bundle; photos that are not defined are passed over.
    concerned : callable
        Whether the points of a photo are looked at.
    """
    names = coded(observations.photos)
    numbers: dict[str, int] = {}

    def camera(name: str) -> int:
        photo = definitions.photos.get(record_key(name))
        if photo is None or not concerned(photo):
            return -1
        return numbers.setdefault(record_key(photo.camera), len(numbers))

    number = names.numbers(camera)
    for key, place in numbers.items():
        found = np.flatnonzero(number == place)
        if len(found):
            yield definitions.cameras[key], found
