"""Covariances of poses, from those of projection centres and angles to those of rotation vectors and centres."""

from __future__ import annotations

import numpy as np

from orip.arrays import FloatArray
from orip.conversion.poses import camera_to_ground_vectors
from orip.geometry.rotation import cross_matrix
from orip.records.exchanged import PoseReading

_SMALL = 1e-4
"""Radians below which a coefficient is taken from its series: the error is the fourth power of it."""


def rotation_vector_covariances(
    rotations: FloatArray, covariances: FloatArray, by_axes: FloatArray, turn: FloatArray, reading: PoseReading
) -> FloatArray:
    """Return the covariances (n, 6, 6) of rotation vectors from camera to ground, radians, and of projection centres.

    Parameters
    ----------
    rotations : array (n, 3, 3)
        Of orip's photos in the frame of the result.
    covariances : array (n, 6, 6)
        Of projection centres and three rotations, radians, in the project's system.
    by_axes : array (n, 3, 3)
        Small rotations about the axes of the frame, of the ground, by these three.
    turn : array (n, 3, 3)
        From the project's axes to those of the frame.
    reading : PoseReading
        Axes of the camera that the vectors refer to.
    """
    vectors = camera_to_ground_vectors(rotations, reading)
    partials = np.zeros((len(rotations), 6, 6))
    partials[:, :3, 3:] = vector_rates_from_axes_rotation(vectors) @ by_axes
    partials[:, 3:, :3] = turn
    # what is not known of angles leaves what is known of places
    found = np.full_like(covariances, np.nan)
    found[:, 3:, 3:] = turn @ covariances[:, :3, :3] @ turn.transpose(0, 2, 1)
    known = np.isfinite(covariances).all(axis=(1, 2))
    found[known] = partials[known] @ covariances[known] @ partials[known].transpose(0, 2, 1)
    return found


def vector_rates_from_axes_rotation(vectors: FloatArray) -> FloatArray:
    """Return the partials (n, 3, 3) of rotation vectors (n, 3) by small rotations about the fixed axes.

    The inverse of the left Jacobian of the rotation group (T. D. Barfoot, State Estimation for Robotics, 2017,
    eq. 7.76): I - [r]x / 2 + (1/a² - cot(a/2) / (2 a)) [r]x², a the length of r.
    """
    angle = np.linalg.norm(vectors, axis=1)
    half = np.maximum(angle, _SMALL) / 2.0
    coefficient = np.where(angle < _SMALL, 1.0 / 12.0, (1.0 - half / np.tan(half)) / (4.0 * half**2))
    cross = cross_matrix(vectors)
    return np.asarray(np.eye(3) - cross / 2.0 + coefficient[:, None, None] * (cross @ cross))
