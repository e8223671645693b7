"""Rigs: the photos that cameras on one body take at one exposure, from its pose and their mountings.

An exposure has a centre E and a rotation R, from the axes of the rig to those of the ground. A camera is mounted at the
offset o along the axes of the rig, with a rotation M from its photo axes to those of the rig. Its photo has

    X0 = E + R o,    rotation = R M
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from orip.arrays import FloatArray
from orip.geometry.rotation import cross_matrix


class RigPhotos(NamedTuple):
    """Exterior orientations of n photos, and how they change with exposure and mounting.

    Attributes
    ----------
    centres : array (n, 3)
        X0, Y0, Z0.
    rotations : array (n, 3, 3)
        Photo to ground.
    by_exposure : array (n, 6, 6)
        Changes of a centre and small rotations about the ground axes, by those of the exposure.
    by_mounting : array (n, 6, 6)
        The same by a change of the offset and small rotations of the camera, both along the axes of the rig.
    """

    centres: FloatArray
    rotations: FloatArray
    by_exposure: FloatArray
    by_mounting: FloatArray


def photos_with_partials(
    centres: FloatArray, rotations: FloatArray, offsets: FloatArray, mountings: FloatArray
) -> RigPhotos:
    """Return the exterior orientations of photos with their partials.

    Small rotations d, e of an exposure and m of a mounting change a photo by dX0 = dE + d x (R o) + R do and
    e = d + R m, since Exp([d]x) R Exp([m]x) M = Exp([d + R m]x) R M to the first order.

    Parameters
    ----------
    centres : array (n, 3)
        Of the exposures, ground units.
    rotations : array (n, 3, 3)
        Of the exposures, rig to ground.
    offsets : array (n, 3)
        Of the cameras, along the axes of the rig, ground units.
    mountings : array (n, 3, 3)
        Of the cameras, photo to rig.
    """
    arms = (rotations @ offsets[:, :, None])[:, :, 0]
    by_exposure, by_mounting = np.zeros((2, len(centres), 6, 6))
    by_exposure[:] = np.eye(6)
    by_exposure[:, :3, 3:] = -cross_matrix(arms)
    by_mounting[:, :3, :3] = by_mounting[:, 3:, 3:] = rotations
    return RigPhotos(centres + arms, rotations @ mountings, by_exposure, by_mounting)


def exposures_of_photos(
    centres: FloatArray, rotations: FloatArray, offsets: FloatArray, mountings: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return centres (n, 3) and rotations (n, 3, 3) of exposures, each from one photo and its camera's mounting.

    Parameters
    ----------
    centres : array (n, 3)
        Of the photos, ground units.
    rotations : array (n, 3, 3)
        Of the photos, photo to ground.
    offsets, mountings : arrays (n, 3) and (n, 3, 3)
        As of `photos_with_partials`.
    """
    of_rig = rotations @ np.swapaxes(mountings, -1, -2)
    return centres - (of_rig @ offsets[:, :, None])[:, :, 0], of_rig
