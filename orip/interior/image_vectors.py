"""Image vectors: photo coordinates freed of the camera's distortion, as directions in the photo system."""

from __future__ import annotations

import numpy as np

from orip.arrays import FloatArray
from orip.geometry.projection import PROJECTIONS
from orip.interior.distortion import corrected_with_partials, remove_distortion
from orip.records.block import Block


def image_vectors(block: Block) -> FloatArray:
    """Return the image vectors of all photo points of a block, mm.

    Returns
    -------
    array (n, 3)
        (x, y, -C) of ideal coordinates reduced to the principal point; of an equidistant camera a vector of the length C
        in the direction of the ray, which may be more than 90 degrees from the axis. NaN where the distortion cannot
        be removed.
    """
    points = block.photo_points
    camera = block.photo_camera[points.photo]
    parameters = np.array([record.parameters for record in block.cameras])
    distorting = parameters[:, 3:].any(axis=1)
    at_measured = np.array([record.distortion_at == "measured" for record in block.cameras])
    vectors = np.column_stack([points.xy - parameters[camera, 1:3], -parameters[camera, 0]])
    rows = np.flatnonzero((distorting & at_measured)[camera])
    corrected = corrected_with_partials(tuple(parameters[camera[rows], 3:].T), vectors[rows, 0], vectors[rows, 1])
    vectors[rows, :2] = np.stack(corrected[:2], axis=1)
    rows = np.flatnonzero((distorting & ~at_measured)[camera])
    vectors[rows, :2] = remove_distortion(vectors[rows, :2], parameters[camera[rows], 3:])
    equidistant = np.array([record.projection == "equidistant" for record in block.cameras])
    rows = np.flatnonzero(equidistant[camera])
    x, y, z = vectors[rows].T
    vectors[rows] = np.stack(PROJECTIONS["equidistant"].image_vector(-z, x, y), axis=1)
    return vectors
