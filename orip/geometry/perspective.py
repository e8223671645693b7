"""The perspective: from a ground point to the ideal photo coordinates, before any distortion.

U = R^T (X - X0) is the point in the photo's axes; the camera looks along its negative z axis:

    x, y = -C U1 / U3, -C U2 / U3

Functions that take plain numbers as well as arrays serve the real-time loop, where arrays of one point would be far
slower.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from orip.arrays import BoolArray, FloatArray, Number
from orip.geometry.rotation import cross_matrix, rotated_back

NAME: Final = "perspective"

LEAST_COSINE = 1e-6
"""Smallest part that the depth of a point has of its distance from the projection centre."""


def is_in_front(u1: Number, u2: Number, u3: Number) -> bool | BoolArray:
    """Tell whether points, numbers or arrays (n,) of U in the photo's axes, are in front of the camera."""
    found: bool | BoolArray = (u3 < 0.0) & (u3 * u3 > LEAST_COSINE**2 * (u1 * u1 + u2 * u2 + u3 * u3))
    return found


def ideal_coordinates(principal_distance: float | Number, u1: Number, u2: Number, u3: Number) -> tuple[Number, Number]:
    """Return the ideal photo coordinates of a point with the coordinates U in the photo's axes."""
    scale = -principal_distance / u3
    return scale * u1, scale * u2


def image_vector(principal_distance: float | Number, x: Number, y: Number) -> tuple[Number, Number, Number]:
    """Return a vector towards what has the ideal coordinates x, y: (x, y, -C)."""
    return x, y, 0.0 * x - principal_distance


class Perspective(NamedTuple):
    """Ideal photo coordinates of n points and their partials.

    Attributes
    ----------
    xy : array (n, 2)
        Ideal coordinates reduced to the principal point, mm.
    by_point : array (n, 2, 3)
        Partials by the ground point (mm per ground unit); those by the projection centre are the negative.
    by_rotation : array (n, 2, 3)
        Partials by a small rotation of the photo about the ground axes (mm per radian).
    by_principal_distance : array (n, 2)
    in_front : array (n,) of bool
        The point is in front of the camera; the other rows mean nothing.
    """

    xy: FloatArray
    by_point: FloatArray
    by_rotation: FloatArray
    by_principal_distance: FloatArray
    in_front: BoolArray

    def of(self, rows: BoolArray) -> Perspective:
        """Return the rows of some of the n points, chosen by flags (n,)."""
        return Perspective(
            self.xy[rows],
            self.by_point[rows],
            self.by_rotation[rows],
            self.by_principal_distance[rows],
            self.in_front[rows],
        )


def perspective_with_partials(
    offset: FloatArray, rotation: FloatArray, principal_distance_mm: FloatArray
) -> Perspective:
    """Return the ideal photo coordinates of ground points.

    Parameters
    ----------
    offset : array (n, 3)
        X - X0, ground units.
    rotation : array (n, 3, 3)
        Photo to ground.
    principal_distance_mm : array (n,)

    Notes
    -----
    With R replaced by Exp([d]x) R the photo-axes vector changes by
    dU = R^T [X - X0]x d (Kraus, Photogrammetry vol. 1, differential form of the collinearity equations).
    """
    u1, u2, u3 = rotated_back(tuple(rotation.reshape(-1, 9).T), *offset.T)
    in_front = np.asarray(is_in_front(u1, u2, u3))
    depth = np.where(in_front, u3, -1.0)
    xy = np.stack(ideal_coordinates(principal_distance_mm, u1, u2, depth), axis=1)
    direction = np.stack(ideal_coordinates(1.0, u1, u2, depth), axis=1)

    by_u = np.zeros((len(xy), 2, 3))
    by_u[:, 0, 0] = by_u[:, 1, 1] = -principal_distance_mm / depth
    by_u[:, :, 2] = -xy / depth[:, None]
    return chained(xy, direction, by_u, offset, rotation, in_front)


def chained(
    xy: FloatArray,
    direction: FloatArray,
    by_u: FloatArray,
    offset: FloatArray,
    rotation: FloatArray,
    in_front: BoolArray,
) -> Perspective:
    """Return images with the partials by ground point and rotation that follow from those by U, array (n, 2, 3)."""
    by_point = by_u @ np.swapaxes(rotation, -1, -2)
    return Perspective(xy, by_point, by_point @ cross_matrix(offset), direction, in_front)
