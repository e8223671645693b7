"""Photo points that were measured in another unit than the marks of their films."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from orip.errors import ProjectWarning
from orip.geometry.plane import PlaneTransformation
from orip.interior.definitions import Definitions
from orip.mistakes.mistake import declare
from orip.records.coded_names import rows_of_records
from orip.records.measurement import PhotoObservations
from orip.wording import counted_names

POINT_UNIT = declare("point-unit", explains_misfit=True)

_FEWEST = 4
"""Points of a photo that show how far its image extends."""

_LARGE = 50.0
"""Ratio of the extents of points and marks that no mounting and no clustered points make, but a factor of 1000 does."""


def points_in_another_unit(
    definitions: Definitions, observations: PhotoObservations, to_photo: Mapping[str, PlaneTransformation]
) -> Iterator[ProjectWarning]:
    """Yield a warning for the photos of each camera whose points were measured in another unit than their marks.

    Parameters
    ----------
    observations : PhotoObservations
        Of one bundle.
    to_photo : mapping by `record_key` of the photo
        Stored coordinates to photo millimetres.
    """
    found: dict[tuple[str, bool], list[str]] = {}
    counts: dict[str, int] = {}
    for key, rows in rows_of_records(observations.photos).items():
        photo = definitions.photos.get(key)
        if photo is None or key not in to_photo or len(rows) < _FEWEST:
            continue
        camera = definitions.camera_of(photo)
        if not camera.fiducials:
            continue
        marks = np.ptp([(mark.x, mark.y) for mark in camera.fiducials], axis=0).max()
        points = np.ptp(to_photo[key].apply(observations.measured[rows]), axis=0).max()
        counts[camera.name] = counts.get(camera.name, 0) + 1
        if points > _LARGE * marks or _LARGE * points < marks:
            found.setdefault((camera.name, bool(points > marks)), []).append(photo.name)
    for (camera_name, are_large), names in found.items():
        where = f"camera {camera_name}" if len(names) == counts[camera_name] else counted_names("photo", names)
        smaller, larger = ("POINTS", "PHOTO") if are_large else ("PHOTO", "POINTS")
        text = (
            f"the points extend over {'far more than' if are_large else 'next to nothing of'} what the fiducial marks "
            f"enclose: the {smaller} lines seem to be in micrometres, and the {larger} lines in mm; measure both in "
            "one unit"
        )
        yield ProjectWarning(POINT_UNIT, where, text)
