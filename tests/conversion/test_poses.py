"""Rotations of other programs: against scipy's, and there and back."""

from __future__ import annotations

import itertools
from typing import get_args

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from orip.exchange.conversion.poses import exchanged_poses, orip_poses
from orip.geometry.rotation import angles_from_rotation, rotation_from_angles
from orip.records.exchanged import AngleUnit, ExchangedPhoto, PoseReading, RotationForm

D = np.diag([1.0, -1.0, -1.0])
ALL_READINGS = [
    PoseReading(axes, sense, form, unit, position)
    for axes, sense, form, unit, position in itertools.product(
        ("y_down", "y_up"), ("to_camera", "to_ground"), get_args(RotationForm), get_args(AngleUnit),
        ("centre", "translation"),
    )
]  # fmt: skip


def one(
    rotation: tuple[float, ...], position: tuple[float, ...], reading: PoseReading
) -> tuple[np.ndarray, np.ndarray]:
    rotations, centres = orip_poses([ExchangedPhoto("a", 0, rotation, position)], reading)
    return rotations[0], centres[0]


@pytest.mark.parametrize("reading", ALL_READINGS, ids=repr)
def test_every_reading_is_undone_by_writing(reading: PoseReading) -> None:
    rotations = Rotation.random(50, rng=np.random.default_rng(1)).as_matrix()
    centres = np.random.default_rng(2).normal(0.0, 100.0, (50, 3))
    numbers, positions = exchanged_poses(rotations, centres, reading)
    photos = [ExchangedPhoto("a", 0, tuple(n), tuple(p)) for n, p in zip(numbers, positions, strict=True)]
    again, at = orip_poses(photos, reading)
    # 1e-12 is some thousand roundings; near phi = 90 degrees angles lose half of the digits of none of these
    assert np.allclose(again, rotations, atol=1e-12)
    assert np.allclose(at, centres, atol=1e-10)


def test_a_quaternion_of_colmap_is_world_to_camera_with_y_down() -> None:
    given = Rotation.from_euler("XYZ", [10.0, -20.0, 30.0], degrees=True)
    quaternion = tuple(3.0 * np.roll(given.as_quat(), 1))  # scipy has w last; the length does not matter
    rotation, centre = one(quaternion, (1.0, 2.0, 3.0), PoseReading(form="quaternion", position="translation"))
    assert np.allclose(rotation, given.as_matrix().T @ D, atol=1e-15)
    assert np.allclose(centre, -given.as_matrix().T @ [1.0, 2.0, 3.0])


@pytest.mark.parametrize(("form", "order"), [("omega_phi_kappa", "XYZ"), ("phi_omega_kappa", "YXZ")])
@pytest.mark.parametrize(("unit", "circle"), [("degree", 360.0), ("gon", 400.0), ("radian", 2.0 * np.pi)])
def test_angles_turn_in_the_order_of_their_name(form: RotationForm, order: str, unit: AngleUnit, circle: float) -> None:
    omega, phi, kappa = 0.03 * circle, -0.05 * circle, 0.21 * circle
    in_order = [omega, phi, kappa] if order == "XYZ" else [phi, omega, kappa]
    expected = Rotation.from_euler(order, 2.0 * np.pi / circle * np.array(in_order)).as_matrix()
    rotation, _ = one((omega, phi, kappa), (), PoseReading("y_up", "to_ground", form, unit))
    assert np.allclose(rotation, expected, atol=1e-15)


def test_a_rotation_vector_is_axis_times_angle() -> None:
    vector = (0.4, -1.1, 2.0)
    rotation, _ = one(vector, (), PoseReading("y_up", "to_ground", "rotation_vector"))
    assert np.allclose(rotation, Rotation.from_rotvec(vector).as_matrix(), atol=1e-15)


def test_the_angles_of_a_y_down_camera_are_turned_by_half_a_circle() -> None:
    """The example of Bentley's documentation of Blocks Exchange: omega near 180 degrees at the nadir."""
    angles = (179.6523, 0.04986, 179.9065)
    rotation, _ = one(angles, (), PoseReading("y_down", "to_ground", "omega_phi_kappa", "degree"))
    assert np.degrees(angles_from_rotation(rotation)) == pytest.approx([-0.3477, -0.04986, -179.9065], abs=1e-9)


def test_photos_without_a_pose_have_none() -> None:
    given = [ExchangedPhoto("a", 0), ExchangedPhoto("b", 0, (1.0, 0.0, 0.0, 0.0), (1.0, 1.0, 1.0))]
    rotations, centres = orip_poses(given, PoseReading(form="quaternion", position="translation"))
    assert np.isnan(rotations[0]).all()
    assert np.isnan(centres[0]).all()
    assert np.isfinite(centres[1]).all()


def test_printed_digits_leave_a_rotation_and_a_mirror_leaves_none() -> None:
    exact = rotation_from_angles(np.array([0.2, -0.3, 1.0]))
    rotation, _ = one(tuple(np.round(exact, 4).ravel()), (), PoseReading("y_up", "to_ground"))
    assert np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-15)
    assert np.allclose(rotation, exact, atol=1e-4)
    mirrored, _ = one(tuple((exact @ np.diag([1.0, 1.0, -1.0])).ravel()), (), PoseReading("y_up", "to_ground"))
    assert np.isnan(mirrored).all()
