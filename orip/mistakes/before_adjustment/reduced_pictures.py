"""Pixels that all lie in the upper left corner of their sensor: measured in pictures of half the size, or a quarter."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from orip.errors import ProjectWarning
from orip.interior.definitions import Definitions
from orip.mistakes.before_adjustment.points_of_camera import points_of_cameras
from orip.records.coded_names import coded
from orip.records.observations.measurement import PhotoObservations

RESOLUTION = "resolution"

_FACTORS = (2, 4, 8)

_FEWEST, _FEWEST_PHOTOS = 100, 3
"""Photo points and photos: photos of one object may show it in one corner."""

_FILLED, _EDGE = 0.9, 1.01
"""Parts of the reduced picture that the points reach."""


def reduced_pictures(definitions: Definitions, observations: PhotoObservations) -> Iterator[ProjectWarning]:
    """Yield a warning for each camera whose photo points fill a corner of its sensor, and no more.

    Parameters
    ----------
    definitions : Definitions
    observations : PhotoObservations
        Of one bundle.
    """
    for camera, rows in points_of_cameras(definitions, observations, lambda _: True):
        photos = coded(observations.photos)[rows].occurring()
        if camera.sensor is None or len(rows) < _FEWEST or len(photos) < _FEWEST_PHOTOS:
            continue
        reached = (observations.measured[rows] / [camera.sensor.columns, camera.sensor.rows]).max(axis=0)
        for factor in _FACTORS:
            if (np.abs(reached * factor - 0.5 * (_FILLED + _EDGE)) < 0.5 * (_EDGE - _FILLED)).all():
                text = (
                    f"all {len(rows)} points lie in the upper left corner of the {camera.sensor.columns} columns and "
                    f"{camera.sensor.rows} rows of the sensor, and would fill it multiplied by {factor}: they seem to "
                    "be measured at a lower resolution; write columns and rows of the pictures that were measured, "
                    "with the same width and height"
                )
                yield ProjectWarning(RESOLUTION, f"camera {camera.name}", text)
