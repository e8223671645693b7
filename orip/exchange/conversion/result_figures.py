"""What formats hold of a result besides its values: error ellipses, covariances of poses, and what photos show."""

from __future__ import annotations

import numpy as np

from orip.arrays import FloatArray
from orip.exchange.conversion.cameras import directions_of_pixels
from orip.exchange.conversion.poses import camera_to_ground_vectors
from orip.geometry.rotation import cross_matrix
from orip.records.camera import Camera
from orip.records.exchanged import PoseReading


def error_ellipses(covariance: FloatArray) -> FloatArray:
    """Return semi-major axis, semi-minor axis and direction of the former (radians, from X to Y) of covariances.

    Parameters
    ----------
    covariance : array (m, 3, 3)
        Of X, Y, Z.

    Returns
    -------
    array (m, 3)
        NaN where X or Y has no variance.

    Notes
    -----
    Closed form of the eigenvalues of a symmetric matrix of two rows.
    """
    xx, xy, yy = covariance[:, 0, 0], covariance[:, 0, 1], covariance[:, 1, 1]
    mean, half = 0.5 * (xx + yy), 0.5 * (xx - yy)
    spread = np.hypot(half, xy)
    axes = np.sqrt(np.maximum(np.stack([mean + spread, mean - spread], axis=1), 0.0))
    return np.column_stack([axes, 0.5 * np.arctan2(xy, half)])


_STEEPEST = 10.0
"""A corner farther away, in heights above the ground, is near the horizon: its place says nothing."""


def footprint(camera: Camera, rotation: FloatArray, centre: FloatArray, ground_height: float) -> FloatArray | None:
    """Return where the rays of the four corners of a photo, with its distortion, meet level ground.

    Parameters
    ----------
    camera : Camera
        With a sensor.
    rotation : array (3, 3)
        Photo axes to ground axes.
    centre : array (3,)
    ground_height : float
        Z of the ground.

    Returns
    -------
    array (4, 3), or None
        Upper left, upper right, lower right, lower left; None where a corner does not show the ground below.
    """
    sensor = camera.sensor
    if sensor is None:
        message = f"camera {camera.name} has no sensor"
        raise ValueError(message)
    columns, rows = float(sensor.columns), float(sensor.rows)
    corners = np.array([[0.0, 0.0], [columns, 0.0], [columns, rows], [0.0, rows]])
    tangents = directions_of_pixels(camera, corners)
    if not np.isfinite(tangents).all():
        return None
    directions = np.column_stack([tangents, -np.ones(4)]) @ rotation.T
    above = centre[2] - ground_height
    reach = np.hypot(directions[:, 0], directions[:, 1])
    if above <= 0.0 or (reach > -_STEEPEST * directions[:, 2]).any():
        return None
    found: FloatArray = centre + directions * (above / -directions[:, 2])[:, None]
    found[:, 2] = ground_height
    return found


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
