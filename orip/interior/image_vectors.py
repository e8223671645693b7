"""Image vectors: photo coordinates freed of the camera's distortion, as directions in the photo system."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from orip.interior.distortion import correction_with_partials, remove_distortion
from orip.model.block import Block

FloatArray = NDArray[np.float64]


def image_vectors(block: Block) -> FloatArray:
    """Return the image vectors (x, y, -C) of all photo points of a block, mm.

    Returns
    -------
    array (n, 3)
        Ideal coordinates reduced to the principal point; NaN where the distortion cannot be removed.
    """
    points = block.photo_points
    camera = block.photo_camera[points.photo]
    parameters = np.array([each.parameters for each in block.cameras])[camera]
    at_measured = np.array([each.distortion_at == "measured" for each in block.cameras])[camera]
    reduced = points.xy - parameters[:, 1:3]
    ideal = np.empty_like(reduced)
    ideal[at_measured] = correction_with_partials(reduced[at_measured], parameters[at_measured, 3:]).value
    ideal[~at_measured] = remove_distortion(reduced[~at_measured], parameters[~at_measured, 3:])
    return np.column_stack([ideal, -parameters[:, 0]])
