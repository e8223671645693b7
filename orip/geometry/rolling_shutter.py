"""Photos by a camera that moves with a body: of rigs at one exposure, or row by row with a rolling shutter.

A point is imaged at t = readout · f, f from −1/2 in the first row to +1/2 in the last one, from where the camera is
then:

    U = (Exp(ω t) R)^T (X − X0 − v t)

X0 and R are those of the middle row. Velocity v and angular rate ω, about the ground axes, are constant during the
readout (Ait-Aider et al. 2006, uniform motion).

An exposure has a centre E and a rotation R, from the axes of the rig to those of the ground. A camera is mounted at the
offset o along the axes of the rig, with a rotation M from its photo axes to those of the rig. Its photo has

    X0 = E + R o,    rotation = R M
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from orip.arrays import BoolArray, FloatArray
from orip.geometry.perspective import Perspective
from orip.geometry.projection import projected_with_partials
from orip.geometry.rotation import cross_matrix, rotation_about_axes

_SMALL_ANGLE = 1e-3
"""Below it the terms that follow in the series are smaller than rounding."""


class Motion(NamedTuple):
    """How cameras move at n photo points.

    Attributes
    ----------
    velocity : array (n, 3)
        Ground units a second.
    rate : array (n, 3)
        Radians a second, about the ground axes.
    """

    velocity: FloatArray
    rate: FloatArray


class MovingImage(NamedTuple):
    """Ideal photo coordinates of n points and their partials.

    Attributes
    ----------
    image : Perspective
        By the ground point, by a small rotation of the photo in the middle row, and by the principal distance.
    by_velocity : array (n, 2, 3)
        mm per ground unit a second.
    by_rate : array (n, 2, 3)
        mm per radian a second.
    by_readout : array (n, 2)
        mm per second.
    """

    image: Perspective
    by_velocity: FloatArray
    by_rate: FloatArray
    by_readout: FloatArray


def moving_image_with_partials(
    offset: FloatArray,
    rotation: FloatArray,
    principal_distance_mm: FloatArray,
    is_equidistant: BoolArray,
    motion: Motion,
    fraction: FloatArray,
    readout: FloatArray,
) -> MovingImage:
    """Return the ideal photo coordinates of ground points, each at the time of its row.

    Parameters
    ----------
    offset : array (n, 3)
        X - X0, ground units.
    rotation : array (n, 3, 3)
        Photo to ground.
    principal_distance_mm : array (n,)
    is_equidistant : array (n,) of bool
        The projection of each point's camera; else the perspective.
    fraction : array (n,)
        Place of the measured row in the order of the readout, -1/2 to 1/2.
    readout : array (n,)
        Seconds from the first to the last row.
    """
    time = (readout * fraction)[:, None]
    turned = motion.rate * time
    turn = rotation_about_axes(turned)
    found = projected_with_partials(
        offset - motion.velocity * time, turn @ rotation, principal_distance_mm, is_equidistant
    )
    by_time = found.by_rotation @ motion.rate[:, :, None] - found.by_point @ motion.velocity[:, :, None]
    return MovingImage(
        found._replace(by_rotation=found.by_rotation @ turn),
        -found.by_point * time[:, :, None],
        found.by_rotation @ _turn_by_vector(turned) * time[:, :, None],
        by_time[:, :, 0] * fraction[:, None],
    )


def _turn_by_vector(vectors: FloatArray) -> FloatArray:
    """Return J (n, 3, 3) with Exp(a + d) = Exp(J d) Exp(a) for small d, for rotation vectors a (n, 3).

    J = I + (1 − cos α) / α² [a]x + (α − sin α) / α³ [a]x² (the left Jacobian of the rotation group).
    """
    angle = np.linalg.norm(vectors, axis=1)
    near = angle < _SMALL_ANGLE
    safe = np.where(near, 1.0, angle)
    first = np.where(near, 0.5 - angle**2 / 24.0, 2.0 * (np.sin(0.5 * safe) / safe) ** 2)
    second = np.where(near, 1.0 / 6.0 - angle**2 / 120.0, (safe - np.sin(safe)) / safe**3)
    k = cross_matrix(vectors)
    return np.asarray(np.eye(3) + first[:, None, None] * k + second[:, None, None] * (k @ k))


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
