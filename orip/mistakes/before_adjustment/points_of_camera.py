"""The photo points of each camera, for the checks of what is measured with it."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from orip.interior.definitions import Definitions
from orip.records.names import record_key
from orip.records.observations.measurement import PhotoObservations
from orip.records.project.camera import Camera
from orip.records.project.photo import Photo


def points_of_cameras(
    definitions: Definitions, observations: PhotoObservations, concerned: Callable[[Photo], bool]
) -> Iterator[tuple[Camera, list[int]]]:
    """Yield each camera with the rows of the photo points that are measured in its photos.

    Parameters
    ----------
    definitions : Definitions
    observations : PhotoObservations
        Of one bundle; photos that are not defined are passed over.
    concerned : callable
        Whether the points of a photo are looked at.
    """
    rows: dict[str, list[int]] = {}
    for row, name in enumerate(observations.photos):
        photo = definitions.photos.get(record_key(name))
        if photo is not None and concerned(photo):
            rows.setdefault(record_key(photo.camera), []).append(row)
    for key, found in rows.items():
        yield definitions.cameras[key], found
