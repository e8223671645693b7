"""The rays that preliminary values are computed from: all photo points of a block that are measured in full."""

from __future__ import annotations

import numpy as np

from orip.interior.image_vectors import image_vectors
from orip.model.block import Block
from orip.model.preliminary import ImageRays


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
    )
