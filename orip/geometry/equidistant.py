"""The equidistant projection of fisheye lenses: images are as far from the principal point as rays are from the axis.

U = R^T (X - X0) is the point in the photo's axes; the camera looks along its negative z axis. With rho the distance of
the point from the axis and theta the angle of its ray from it, which may be 90 degrees and more:

    rho = sqrt(U1² + U2²)           theta = atan2(rho, -U3)
    x, y = C theta U1 / rho, C theta U2 / rho

(Kannala and Brandt 2006; Schneider, Schwalbe and Maas 2009). Near the axis this is the perspective.

What takes plain numbers as well as arrays serves the real-time loop, where arrays of one point would be far slower.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from orip.arrays import BoolArray, FloatArray, Number
from orip.geometry.perspective import Perspective, chained
from orip.geometry.rotation import rotated_back

NAME: Final = "equidistant"

LARGEST_ANGLE = math.radians(175.0)
"""Angle from the axis beyond which nothing is shown: straight behind the camera a point has no image."""

LEAST_COSINE = math.cos(LARGEST_ANGLE)
_ON_AXIS = 1e-16
"""Square of the angle from the axis below which its third power is nothing beside it."""


def is_in_front(u1: Number, u2: Number, u3: Number) -> bool | BoolArray:
    """Tell whether points, numbers or arrays (n,) of U in the photo's axes, have an image."""
    found: bool | BoolArray = -u3 > LEAST_COSINE * (u1 * u1 + u2 * u2 + u3 * u3) ** 0.5
    return found


def ideal_coordinates(principal_distance: float | Number, u1: Number, u2: Number, u3: Number) -> tuple[Number, Number]:
    """Return the ideal photo coordinates of a point with the coordinates U in the photo's axes."""
    scale = principal_distance * _angle_over_distance((u1 * u1 + u2 * u2) ** 0.5, u3)
    return scale * u1, scale * u2


def image_vector(principal_distance: float | Number, x: Number, y: Number) -> tuple[Number, Number, Number]:
    """Return the vector of length C towards what has the ideal coordinates x, y; NaN beyond `LARGEST_ANGLE`."""
    angle = (x * x + y * y) ** 0.5 / principal_distance
    factor, cosine = _sine_over_angle_and_cosine(angle)
    return factor * x, factor * y, -principal_distance * cosine


def equidistant_with_partials(
    offset: FloatArray, rotation: FloatArray, principal_distance_mm: FloatArray
) -> Perspective:
    """Return the ideal photo coordinates of ground points, as `perspective_with_partials` does.

    Notes
    -----
    With s = theta / rho and d² = U1² + U2² + U3² the differential of s is q (U1 dU1 + U2 dU2) + dU3 / d², where
    q = (-U3 / d² - s) / rho².
    """
    u1, u2, u3 = rotated_back(tuple(rotation.reshape(-1, 9).T), *offset.T)
    in_front = np.asarray(is_in_front(u1, u2, u3))
    u1, u2, u3 = (np.where(in_front, u, at) for u, at in ((u1, 0.0), (u2, 0.0), (u3, -1.0)))
    across, square = u1 * u1 + u2 * u2, u1 * u1 + u2 * u2 + u3 * u3
    scale = np.asarray(_angle_over_distance(np.sqrt(across), u3))
    off_axis = across > _ON_AXIS * square
    bend = np.where(off_axis, (-u3 / square - scale) / np.where(off_axis, across, 1.0), 0.0)
    by_u = np.empty((len(square), 2, 3))
    by_u[:, 0, 0], by_u[:, 1, 1] = scale + bend * u1 * u1, scale + bend * u2 * u2
    by_u[:, 0, 1] = by_u[:, 1, 0] = bend * u1 * u2
    by_u[:, 0, 2], by_u[:, 1, 2] = u1 / square, u2 / square
    by_u *= principal_distance_mm[:, None, None]
    direction = np.stack([scale * u1, scale * u2], axis=1)
    return chained(principal_distance_mm[:, None] * direction, direction, by_u, offset, rotation, in_front)


def _sine_over_angle_and_cosine(angle: Number) -> tuple[Number, Number]:
    if isinstance(angle, float):
        if not angle < LARGEST_ANGLE:
            return math.nan, math.nan
        return (math.sin(angle) / angle if angle > 0.0 else 1.0), math.cos(angle)
    shown = np.where(angle < LARGEST_ANGLE, angle, np.nan)
    return np.sinc(shown / np.pi), np.cos(shown)


def _angle_over_distance(across: Number, u3: Number) -> Number:
    """Return theta / rho for rho and U3; on the axis its limit -1 / U3."""
    if isinstance(across, float):
        return math.atan2(across, -u3) / across if across > 0.0 else -1.0 / u3
    off_axis = across > 0.0
    return np.where(off_axis, np.arctan2(across, -u3), -1.0) / np.where(off_axis, across, u3)
