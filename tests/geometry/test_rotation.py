"""Rotations against scipy's, against the table of docs/conventions.md, and against each other."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from orip.geometry.rotation import (
    angle_rates_from_axes_rotation,
    angles_from_rotation,
    axes_rotation_from_angle_rates,
    cross_matrix,
    rotation_about_axes,
    rotation_from_angles,
    rotation_vectors_with_partials,
)

HALF_TURN = np.pi / 2.0
ROUNDING = 1e-14  # a handful of products of numbers up to 1, in doubles
ANGLES = st.tuples(*[st.floats(-4.0, 4.0)] * 3).map(np.array)
TURNS = st.tuples(*[st.floats(-7.0, 7.0)] * 3).map(np.array)


@given(ANGLES)
def test_rotation_is_the_intrinsic_xyz_rotation_of_scipy(angles):
    assert np.allclose(rotation_from_angles(angles), Rotation.from_euler("XYZ", angles).as_matrix(), atol=ROUNDING)


@given(ANGLES)
def test_rotation_is_orthogonal_and_right_handed(angles):
    r = rotation_from_angles(angles)
    assert np.allclose(r @ r.T, np.eye(3), atol=ROUNDING)
    assert np.linalg.det(r) == pytest.approx(1.0, abs=ROUNDING)


@given(ANGLES)
def test_angles_of_a_rotation_give_the_rotation_again(angles):
    r = rotation_from_angles(angles)
    found = angles_from_rotation(r)
    assert np.abs(found[[0, 2]]).max() <= np.pi
    assert abs(found[1]) <= HALF_TURN
    # below the limit of gimbal lock, a cosine of 1e-9, kappa is written as 0
    assert np.allclose(rotation_from_angles(found), r, atol=3e-9)


@given(st.floats(-3.1, 3.1), st.floats(-1.5, 1.5), st.floats(-3.1, 3.1))
def test_angles_themselves_come_back_away_from_gimbal_lock(omega, phi, kappa):
    angles = np.array([omega, phi, kappa])
    assert np.allclose(angles_from_rotation(rotation_from_angles(angles)), angles, atol=1e-12)


@pytest.mark.parametrize("phi", [HALF_TURN, -HALF_TURN])
@pytest.mark.parametrize(("omega", "kappa"), [(0.0, 0.0), (0.3, 0.0), (0.0, 1.2), (-2.0, 0.7), (3.0, -3.0)])
def test_kappa_is_written_as_zero_where_the_camera_looks_along_x(phi, omega, kappa):
    r = rotation_from_angles(np.array([omega, phi, kappa]))
    found = angles_from_rotation(r)
    assert found[2] == 0.0
    assert found[1] == pytest.approx(phi, abs=1e-15)
    assert np.allclose(rotation_from_angles(found), r, atol=ROUNDING)


@pytest.mark.parametrize(
    ("omega", "phi", "direction"),
    [
        (0.0, 0.0, (0.0, 0.0, -1.0)),
        (90.0, 0.0, (0.0, 1.0, 0.0)),
        (-90.0, 0.0, (0.0, -1.0, 0.0)),
        (0.0, -90.0, (1.0, 0.0, 0.0)),
        (0.0, 90.0, (-1.0, 0.0, 0.0)),
    ],
)
@pytest.mark.parametrize("kappa", [0.0, 25.0])
def test_viewing_direction_of_the_conventions(omega, phi, kappa, direction):
    r = rotation_from_angles(np.radians([omega, phi, kappa]))
    assert np.allclose(-r[:, 2], direction, atol=ROUNDING)


def test_each_angle_turns_about_its_own_axis_by_the_right_hand():
    for axis in range(3):
        angles = np.zeros(3)
        angles[axis] = HALF_TURN
        turned = rotation_from_angles(angles) @ np.eye(3)[(axis + 1) % 3]
        assert np.allclose(turned, np.eye(3)[(axis + 2) % 3], atol=ROUNDING)


def test_many_rotations_at_once_are_those_one_by_one():
    angles = np.linspace(-3.0, 3.0, 30).reshape(2, 5, 3)
    together = rotation_from_angles(angles)
    assert together.shape == (2, 5, 3, 3)
    for place in np.ndindex(2, 5):
        assert np.array_equal(together[place], rotation_from_angles(angles[place]))
    assert np.allclose(rotation_from_angles(angles_from_rotation(together)), together, atol=ROUNDING)


@given(TURNS)
def test_turn_about_axes_is_the_rotation_vector_of_scipy(delta):
    assert np.allclose(rotation_about_axes(delta), Rotation.from_rotvec(delta).as_matrix(), atol=ROUNDING)


@given(TURNS)
def test_vector_of_a_rotation_is_that_of_scipy(delta):
    rotation = Rotation.from_rotvec(delta)
    found = rotation_vectors_with_partials(rotation.as_matrix())[0]
    # at half a turn both directions are right
    assert np.allclose(rotation_about_axes(found), rotation.as_matrix(), atol=10.0 * ROUNDING)
    assert np.linalg.norm(found) == pytest.approx(rotation.magnitude(), abs=10.0 * ROUNDING)


@given(TURNS)
def test_turn_and_turn_back_cancel(delta):
    assert np.allclose(rotation_about_axes(delta) @ rotation_about_axes(-delta), np.eye(3), atol=ROUNDING)


@pytest.mark.parametrize("size", [0.0, 1e-300, 1e-160, 1e-16, 1e-9, 1e-5, np.pi, 2.0 * np.pi, 1e4])
def test_tiny_and_large_turns_are_rotations(size):
    delta = size * np.array([0.6, 0.0, 0.8])
    r = rotation_about_axes(delta)
    assert np.allclose(r @ r.T, np.eye(3), atol=ROUNDING)
    # the angle itself is rounded, at 1e4 radians to 2e-12
    assert np.allclose(r, Rotation.from_rotvec(delta).as_matrix(), atol=max(ROUNDING, 1e-15 * size))


def test_tiny_turn_is_the_cross_product_to_the_last_digit():
    delta = np.array([1e-20, -2e-20, 3e-20])
    difference = rotation_about_axes(delta) - np.eye(3)
    expected = cross_matrix(delta)
    off_diagonal = ~np.eye(3, dtype=bool)
    assert np.allclose(difference[off_diagonal], expected[off_diagonal], rtol=1e-15, atol=0.0)


@given(st.tuples(*[st.floats(-1e3, 1e3)] * 6).map(np.array))
def test_cross_matrix_is_the_cross_product(six):
    assert np.allclose(cross_matrix(six[:3]) @ six[3:], np.cross(six[:3], six[3:]), atol=1e-9)


@given(st.floats(-3.0, 3.0), st.floats(-1.5, 1.5), st.floats(-3.0, 3.0))
def test_rates_of_angles_and_turns_about_axes_are_inverse(omega, phi, kappa):
    angles = np.array([omega, phi, kappa])
    there, back = axes_rotation_from_angle_rates(angles), angle_rates_from_axes_rotation(angles)
    # the inverse grows with 1 / cos(phi), here up to 14
    assert np.allclose(there @ back, np.eye(3), atol=1e-13)
    assert np.linalg.det(there) == pytest.approx(np.cos(phi), abs=ROUNDING)


@given(st.floats(-3.0, 3.0), st.floats(-1.6, 1.6), st.floats(-3.0, 3.0))
def test_rates_of_angles_are_the_derivative_of_the_rotation(omega, phi, kappa):
    angles = np.array([omega, phi, kappa])
    r, rates = rotation_from_angles(angles), axes_rotation_from_angle_rates(angles)
    step = 1e-6
    for angle in range(3):
        change = step * np.eye(3)[angle]
        numerical = (rotation_from_angles(angles + change) - rotation_from_angles(angles - change)) / (2.0 * step)
        # truncation step² / 6, rounding 1e-16 / step
        assert np.allclose(numerical, cross_matrix(rates[:, angle]) @ r, atol=1e-9)
