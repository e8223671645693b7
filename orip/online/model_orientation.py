"""A photo oriented to one that is oriented already: relative orientation, with the scale of known points."""

from __future__ import annotations

import numpy as np

from orip.arrays import FloatArray
from orip.bundle.part_of_block import part_of_block
from orip.geometry.rotation import angles_from_rotation, rotation_from_angles
from orip.prelim.rays.image_rays import image_rays, rays_of_plane_images
from orip.prelim.relative.orientation import orient_pair
from orip.records.block import Block
from orip.records.results.preliminary import RelativeOrientation

_COMMON_POINTS = 7
"""Five determine a relative orientation; two more tell whether it is right."""

_LARGEST_SEUW = 5.0
"""Mean parallax, in a-priori errors, from which a relative orientation is not believed."""


def orientation_by_model(block: Block, photo: int) -> FloatArray | None:
    """Return the orientation (6,) of a photo by its common points with the oriented photo that has most of them.

    Parameters
    ----------
    block : Block
        With orientations and coordinates as far as there are any, NaN elsewhere.
    photo : int
        The photo that is not oriented.

    Returns
    -------
    array (6,) or None
        In the order of `PHOTO_PARAMETERS`; None where too few points are common, they do not fit, or none of them has
        coordinates to take the scale from.
    """
    rays = block.photo_points
    shown = np.zeros((len(block.photos), len(block.point_names)), dtype=bool)
    shown[rays.photo, rays.point] = rays.used.all(axis=1)
    oriented = np.isfinite(block.photo_orientation).all(axis=1)
    common = np.where(oriented, (shown & shown[photo]).sum(axis=1), 0)
    common[photo] = 0
    left = int(np.argmax(common))
    if common[left] < _COMMON_POINTS:
        return None
    pair = np.zeros(len(block.photos), dtype=bool)
    pair[[left, photo]] = True
    part = part_of_block(block, pair, shown[left] & shown[photo])
    first = 0 if left < photo else 1
    found = orient_pair(rays_of_plane_images(part, image_rays(part)), first, 1 - first, model="", row=None, column=None)
    if not isinstance(found, RelativeOrientation) or found.seuw > _LARGEST_SEUW:
        return None
    return _in_block(part, found, first)


def _in_block(part: Block, found: RelativeOrientation, first: int) -> FloatArray | None:
    """Return the orientation of the second photo of a pair in the system of the first."""
    orientation, model = part.photo_orientation[first], found.block
    distances = np.linalg.norm(part.point_start[model.points] - orientation[:3], axis=1)
    scales = distances / np.linalg.norm(model.coordinates, axis=1)
    scales = scales[np.isfinite(scales)]
    if not len(scales):
        return None
    rotation = rotation_from_angles(orientation[None, 3:])[0]
    centre = orientation[:3] + float(np.median(scales)) * rotation @ model.centres[1]
    return np.concatenate([centre, angles_from_rotation((rotation @ model.rotations[1])[None])[0]])
