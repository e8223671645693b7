"""Synthetic blocks as a user of the API has them: plain arrays."""

from __future__ import annotations

from typing import Any

import numpy as np

import orip
from orip.records.block import Block


def arrays_of(block: Block) -> dict[str, Any]:
    """Return the arguments with which `orip.Block` makes the same block."""
    (camera,) = block.cameras
    photos = np.array([photo.name for photo in block.photos])
    points = np.array(block.point_names)
    measured = block.photo_points
    control = block.control_points
    return {
        "cameras": [orip.Camera(camera.name, camera.parameters[0], camera.parameters[1:3], unknown=camera.unknown)],
        "photos": orip.Photos(photos, camera.name, [photo.orientation for photo in block.photos]),
        "photo_points": orip.PhotoPoints(
            photos[measured.photo], points[measured.point], measured.xy, np.where(measured.used, measured.error, -1.0)
        ),
        "control_points": orip.ControlPoints(
            [point.name for point in control],
            [point.coordinates for point in control],
            [point.errors for point in control],
        ),
        "datum": block.definition.datum,
    }
