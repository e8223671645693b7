"""The principal distance that given points tell of where the orientations of photos are roughly known."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from orip.arrays import FloatArray
from orip.bundle.starting_points import given_coordinates
from orip.geometry.rotation import rotation_from_angles
from orip.records.block import Block

_NEAR_AXIS = 0.02
"""Tangent of the angle from the axis of the camera within which a point says nothing of the principal distance."""


def principal_distance_seen(block: Block, camera: int) -> float:
    """Return the median of photo coordinates over the tangents of the angles at which given points are seen, mm.

    Parameters
    ----------
    block : Block
        With orientations of the photos.
    camera : int
        Its index.

    Returns
    -------
    float
        The camera's own principal distance where its photos show no point whose coordinates are given in full.
    """
    own = block.cameras[camera].parameters
    rows, ground = _of_given_points(block, camera)
    photo = block.photo_points.photo[rows]
    orientation = block.photo_orientation[photo]
    u = np.einsum("ni,nij->nj", ground - orientation[:, :3], rotation_from_angles(orientation[:, 3:]))
    with np.errstate(divide="ignore", invalid="ignore"):
        tangents = u[:, :2] / -u[:, 2:]
    size = np.sum(tangents**2, axis=1)
    told = (u[:, 2] < 0.0) & (size > _NEAR_AXIS**2)
    xy = block.photo_points.xy[rows] - np.array(own[1:3])
    found = np.sum(xy * tangents, axis=1)[told] / size[told]
    found = found[found > 0.0]
    return float(np.median(found)) if len(found) else own[0]


def _of_given_points(block: Block, camera: int) -> tuple[NDArray[np.int64], FloatArray]:
    """Return rows of photo points that show points given in full, and these (n, 3) in the frame of the block."""
    known, points = given_coordinates(block), block.photo_points
    full: NDArray[np.bool_] = np.asarray(np.isfinite(known).all(axis=1))
    rows = np.flatnonzero(full[points.point] & (block.photo_camera[points.photo] == camera) & points.used.all(axis=1))
    return rows, block.ground.to_local(known[points.point[rows]])
