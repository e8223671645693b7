"""Image vectors: photo coordinates freed of the camera's distortion, as directions in the photo system."""

from __future__ import annotations

import numpy as np

from orip.arrays import FloatArray
from orip.interior.distortion import correction_with_partials, remove_distortion
from orip.records.block import Block


def image_vectors(block: Block) -> FloatArray:
    """Return the image vectors (x, y, -C) of all photo points of a block, mm.

    Returns
    -------
    array (n, 3)
        Ideal coordinates reduced to the principal point; NaN where the distortion cannot be removed.
    """
    points = block.photo_points
    camera = block.photo_camera[points.photo]
    parameters = np.array([each.parameters for each in block.cameras])
    distorting = parameters[:, 3:].any(axis=1)
    at_measured = np.array([each.distortion_at == "measured" for each in block.cameras])
    vectors = np.column_stack([points.xy - parameters[camera, 1:3], -parameters[camera, 0]])
    rows = np.flatnonzero((distorting & at_measured)[camera])
    vectors[rows, :2] = correction_with_partials(vectors[rows, :2], parameters[camera[rows], 3:]).value
    rows = np.flatnonzero((distorting & ~at_measured)[camera])
    vectors[rows, :2] = remove_distortion(vectors[rows, :2], parameters[camera[rows], 3:])
    return vectors
