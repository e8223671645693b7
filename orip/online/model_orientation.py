"""A photo oriented to one that is oriented already: relative orientation, with the scale of known points."""

from __future__ import annotations

import numpy as np

from orip.arrays import BoolArray, FloatArray
from orip.bundle.antennas import part_of_block
from orip.geometry.rotation import angles_from_rotation, rotation_from_angles
from orip.prelim.rays import image_rays, rays_of_plane_images
from orip.prelim.relative.orientation import orient_pair
from orip.records.block import Block
from orip.records.results.preliminary import RelativeOrientation

_COMMON_POINTS = 7
"""Five determine a relative orientation; two more tell whether it is right."""

_LARGEST_SEUW = 5.0
"""Mean parallax, in a-priori errors, from which a relative orientation is not believed."""


def orientation_by_model(pair: Block, photo: str) -> FloatArray | None:
    """Return the orientation (6,) of a photo by its common points with one that is oriented.

    Parameters
    ----------
    pair : Block
        The two photos and their common points, with orientation and coordinates as far as there are any, NaN elsewhere.
    photo : str
        The one that is not oriented.

    Returns
    -------
    array (6,) or None
        In the order of `PHOTO_PARAMETERS`; None where too few points are common, they do not fit, or none of them has
        coordinates to take the scale from.
    """
    rays = pair.photo_points
    shown = np.zeros((len(pair.photos), len(pair.point_names)), dtype=bool)
    shown[rays.photo, rays.point] = rays.in_use
    common: BoolArray = np.asarray(shown.all(axis=0))
    if common.sum() < _COMMON_POINTS:
        return None
    part = part_of_block(pair, np.ones(len(pair.photos), dtype=bool), common)
    first = int(part.photos[0].name == photo)
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
