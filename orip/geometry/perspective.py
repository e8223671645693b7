"""The perspective: from a ground point to the ideal photo coordinates, before any distortion."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from orip.arrays import FloatArray
from orip.geometry.rotation import cross_matrix


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
    in_front: NDArray[np.bool_]

    def of(self, rows: NDArray[np.bool_]) -> Perspective:
        """Return the rows of some points."""
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
    """Project ground points: U = R^T (X - X0), (x, y) = -C (U1, U2) / U3.

    Parameters
    ----------
    offset : array (n, 3)
        X - X0, ground units.
    rotation : array (n, 3, 3)
        Photo to ground.
    principal_distance_mm : array (n,)

    Returns
    -------
    Perspective

    Notes
    -----
    The camera looks along its negative z axis. With R replaced by Exp([d]x) R the photo-axes vector changes by
    dU = R^T [X - X0]x d (Kraus, Photogrammetry vol. 1, differential form of the collinearity equations).
    """
    to_photo = np.swapaxes(rotation, -1, -2)
    u = (to_photo @ offset[:, :, None])[:, :, 0]
    depth = u[:, 2]
    in_front = depth < -1e-6 * np.linalg.norm(u, axis=1)
    depth = np.where(in_front, depth, -1.0)
    direction = -u[:, :2] / depth[:, None]
    xy = principal_distance_mm[:, None] * direction

    scale = -principal_distance_mm / depth
    by_u = np.zeros((len(u), 2, 3))
    by_u[:, 0, 0] = by_u[:, 1, 1] = scale
    by_u[:, :, 2] = -xy / depth[:, None]
    by_point = by_u @ to_photo
    return Perspective(xy, by_point, by_point @ cross_matrix(offset), direction, in_front)
