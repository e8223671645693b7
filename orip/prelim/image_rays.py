"""The rays that preliminary values are computed from: all photo points of a block that are measured in full."""

from __future__ import annotations

import numpy as np

from orip.interior.image_vectors import image_vectors
from orip.records.block import Block
from orip.records.preliminary import ALL_KNOWN, ImageRays, UnknownCameras

_CORRECTED = "C", "DX", "DY", "A3"
"""Parameters of a camera that the `CAMERA_CORRECTIONS` stand for."""


def image_rays(block: Block) -> ImageRays:
    """Return the rays of a block, point by point; indices of photos and points are the block's.

    Points of which a coordinate is disregarded, or whose distortion cannot be removed, give no ray.
    """
    points = block.photo_points
    vectors = image_vectors(block)
    rows = np.flatnonzero(points.used.all(axis=1) & np.isfinite(vectors).all(axis=1))
    rows = rows[np.argsort(points.point[rows], kind="stable")]
    return ImageRays(
        photos=tuple(photo.name for photo in block.photos),
        points=block.point_names,
        photo=points.photo[rows],
        point=points.point[rows],
        xy=points.xy[rows],
        vectors=vectors[rows],
        error=np.sqrt(np.mean(points.error[rows] ** 2, axis=1)),
        cameras=_unknown_cameras(block),
    )


def _unknown_cameras(block: Block) -> UnknownCameras:
    unknown = np.array([[name in camera.unknown for name in _CORRECTED] for camera in block.cameras])
    rows = np.flatnonzero(unknown.any(axis=1))
    if not len(rows):
        return ALL_KNOWN
    place = np.full(len(block.cameras), -1)
    place[rows] = np.arange(len(rows))
    return UnknownCameras(place[block.photo_camera], unknown[rows])
