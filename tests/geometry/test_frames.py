"""Coordinate frames against PROJ, SciPy and closed forms."""

from __future__ import annotations

import numpy as np
import pyproj
import pytest
from scipy.spatial.transform import Rotation

from orip.geometry.frames import (
    EARTH_RATE,
    changes_of_wander,
    earth_from_inertial,
    local_coordinates,
    local_from_body,
    local_from_earth,
    rotation_from_terrestrial,
    terrestrial_from_rotation,
    terrestrial_rates,
    wander_from_local,
)
from orip.geometry.rotation import rotation_about_axes, rotation_from_navigation

WGS84 = (6378137.0, 6378137.0 * (1.0 - 1.0 / 298.257223563))
RANDOM = np.random.default_rng(5)


def test_local_level_coordinates_are_those_of_proj() -> None:
    origin = np.array([np.radians(9.9), np.radians(53.5), 40.0])
    places = origin + RANDOM.normal(size=(20, 3)) * [0.01, 0.01, 100.0]
    text = (
        "+proj=pipeline +step +proj=cart +ellps=WGS84 "
        f"+step +proj=topocentric +ellps=WGS84 +lon_0={np.degrees(origin[0])} +lat_0={np.degrees(origin[1])} +h_0=40"
    )
    transformer = pyproj.Transformer.from_pipeline(text)
    expected = np.column_stack(transformer.transform(*places.T, radians=True))
    assert local_coordinates(places, origin, WGS84) == pytest.approx(expected, abs=1e-7)


def test_the_earth_turns_once_in_a_sidereal_day() -> None:
    turned = earth_from_inertial(np.array([0.0, 2.0 * np.pi / EARTH_RATE / 4.0]))
    assert turned[0] == pytest.approx(np.eye(3))
    # after a quarter of a turn what is fixed along x of the inertial frame is a quarter of a turn to the west
    assert turned[1] @ [1.0, 0.0, 0.0] == pytest.approx([0.0, -1.0, 0.0], abs=1e-12)
    assert 2.0 * np.pi / EARTH_RATE == pytest.approx(86164.1, abs=0.1)


def test_the_rotation_of_the_earth_in_the_local_frame_is_its_closed_form() -> None:
    latitude = np.radians([-30.0, 0.0, 53.0, 89.0])
    places = np.column_stack([np.radians([10.0, 200.0, -70.0, 0.0]), latitude, np.zeros(4)])
    found = EARTH_RATE * local_from_earth(places)[:, :, 2]
    expected = EARTH_RATE * np.column_stack([np.zeros(4), np.cos(latitude), np.sin(latitude)])
    assert found == pytest.approx(expected, abs=1e-18)


def test_a_wander_frame_is_turned_counter_clockwise_from_north() -> None:
    (turned,) = wander_from_local(np.array([np.radians(30.0)]))
    # its y axis lies 30 degrees west of north
    assert pytest.approx([-0.5, np.sqrt(0.75), 0.0]) == turned.T @ [0.0, 1.0, 0.0]


def test_a_wander_frame_is_carried_without_turning() -> None:
    """The turn of the wander frame along a path has no part about up; that of the local frame has."""
    along = np.linspace(0.0, 1.0, 2001)
    path = np.column_stack([2.0 * along, np.radians(80.0) + 0.1 * np.sin(3.0 * along), np.zeros(2001)])
    wander = np.concatenate([[0.0], np.cumsum(changes_of_wander(path))])
    axes = wander_from_local(wander) @ local_from_earth(path)
    steps = Rotation.from_matrix(axes[1:] @ np.swapaxes(axes[:-1], 1, 2)).as_rotvec()
    assert np.abs(steps[:, 2]).max() < 1e-8 < np.abs(np.diff(path[:, 0])).min()


def test_body_and_photo_frames_agree() -> None:
    angles = RANDOM.normal(size=(10, 3))
    # a camera that looks down with the top of its picture forward: right, front, up
    photo_to_body = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
    assert local_from_body(angles) @ photo_to_body == pytest.approx(rotation_from_navigation(angles), abs=1e-14)
    ned = Rotation.from_euler("ZYX", angles[:, ::-1]).as_matrix()
    assert local_from_body(angles)[:, [1, 0, 2]] * [[[1.0], [1.0], [-1.0]]] == pytest.approx(ned, abs=1e-14)


def test_angles_of_terrestrial_photos_are_those_of_their_axes() -> None:
    angles = np.column_stack(
        [RANDOM.uniform(-3.1, 3.1, 50), RANDOM.uniform(-1.5, 1.5, 50), RANDOM.uniform(-3.1, 3.1, 50)]
    )
    rotations = rotation_from_terrestrial(angles)
    expected = Rotation.from_euler("ZXZ", np.add(angles, [0.0, np.pi / 2.0, 0.0])).as_matrix()
    assert rotations == pytest.approx(expected, abs=1e-14)
    assert terrestrial_from_rotation(rotations) == pytest.approx(angles, abs=1e-12)
    # upright, looking to +Y: x of the photo is X, its y is Z, it looks along -z
    assert rotation_from_terrestrial(np.zeros((1, 3)))[0] == pytest.approx(np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]]))


def test_straight_down_the_angles_still_give_the_rotation() -> None:
    rotations = Rotation.from_euler("ZXZ", [[0.3, 0.0, 0.2], [0.3, np.pi, 0.2]]).as_matrix()
    found = terrestrial_from_rotation(rotations)
    assert found[:, 2].tolist() == [0.0, 0.0]
    assert rotation_from_terrestrial(found) == pytest.approx(rotations, abs=1e-12)


def test_rates_of_terrestrial_angles() -> None:
    angles = np.array([[0.4, -0.3, 1.2], [-2.0, 0.9, 0.1]])
    step = 1e-6
    for axis in range(3):
        delta = np.zeros((2, 3))
        delta[:, axis] = step
        ends = [
            terrestrial_from_rotation(rotation_about_axes(sign * delta) @ rotation_from_terrestrial(angles))
            for sign in (1.0, -1.0)
        ]
        numerical = (ends[0] - ends[1]) / (2.0 * step)
        assert terrestrial_rates(angles)[:, :, axis] == pytest.approx(numerical, abs=1e-8)
