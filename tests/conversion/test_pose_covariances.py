"""Covariances of rotation vectors, beside differences of the vectors themselves."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from orip.exchange.conversion.result_figures import rotation_vector_covariances, vector_rates_from_axes_rotation
from orip.geometry.rotation import axes_rotation_from_angle_rates, rotation_from_angles
from orip.records.exchanged import PoseReading

ANGLES = np.array([[0.02, -0.03, 0.5], [0.4, 0.6, -2.0], [-1.2, 0.2, 3.0], [1.5, -1.4, 0.1]])
STEP = 1e-6


def vectors_of(angles: np.ndarray) -> np.ndarray:
    """Return rotation vectors from axes x right, y down, z forward to the ground, by another program."""
    return Rotation.from_matrix(rotation_from_angles(angles) @ np.diag([1.0, -1.0, -1.0])).as_rotvec()


def test_rates_of_rotation_vectors_are_differences() -> None:
    vectors = np.vstack([vectors_of(ANGLES), [[0.0, 0.0, 0.0], [1e-5, -2e-5, 1e-5], [np.pi - 1e-4, 0.0, 0.0]]])
    found = vector_rates_from_axes_rotation(vectors)
    for axis in range(3):
        turn = np.eye(3)[axis] * STEP
        one, other = (
            (Rotation.from_rotvec(sign * turn) * Rotation.from_rotvec(vectors)).as_rotvec() for sign in (1.0, -1.0)
        )
        # central differences: the second order is left, and 1e-16 over the step
        np.testing.assert_allclose(found[:, :, axis], (one - other) / (2.0 * STEP), atol=1e-9)


def test_covariances_are_those_of_the_numbers_in_the_file() -> None:
    rng = np.random.default_rng(3)
    root = rng.normal(size=(len(ANGLES), 6, 6)) * 1e-3
    given = root @ root.transpose(0, 2, 1)
    nothing = np.broadcast_to(np.eye(3), (len(ANGLES), 3, 3))
    rotations = rotation_from_angles(ANGLES)
    by_axes = axes_rotation_from_angle_rates(ANGLES)
    found = rotation_vector_covariances(rotations, given, by_axes, nothing, PoseReading("y_down"))
    partials = np.zeros((len(ANGLES), 6, 6))
    partials[:, 3:, :3] = np.eye(3)
    for angle in range(3):
        step = np.eye(3)[angle] * STEP
        partials[:, :3, 3 + angle] = (vectors_of(ANGLES + step) - vectors_of(ANGLES - step)) / (2.0 * STEP)
    expected = partials @ given @ partials.transpose(0, 2, 1)
    np.testing.assert_allclose(found, expected, atol=1e-8 * np.abs(expected).max())


def test_unknown_angles_leave_the_covariance_of_the_centre() -> None:
    given = np.full((1, 6, 6), np.nan)
    given[0, :3, :3] = np.diag([1.0, 4.0, 9.0])
    turn = Rotation.from_rotvec([[0.1, -0.2, 0.3]]).as_matrix()
    rotations = rotation_from_angles(ANGLES[:1])
    found = rotation_vector_covariances(rotations, given, turn, turn, PoseReading("y_down"))
    assert found[0, 3:, 3:] == pytest.approx(turn[0] @ np.diag([1.0, 4.0, 9.0]) @ turn[0].T)
    assert np.isnan(found[0, :3]).all()
