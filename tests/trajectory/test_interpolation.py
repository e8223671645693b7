"""Between the epochs of a trajectory: places, attitudes, gaps."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

from orip.geometry.rotation import rotation_from_navigation
from orip.records.epochs import Epochs, epochs
from orip.stations.interpolation import interpolate, moved, time_complaints, without_contradicting_velocities


def trajectory(time: np.ndarray, place: np.ndarray, **more: object) -> Epochs:
    return epochs("t.pos", np.arange(10, 10 + len(time)), time=time, place=place, is_geographic=False, **more)


def test_cubic_motion_is_met_exactly_with_velocities() -> None:
    time = np.arange(0.0, 5.0, 1.0)
    coefficients = np.random.RandomState(1).normal(size=(3, 4))
    place = np.column_stack([np.polyval(line, time) for line in coefficients])
    velocity = np.column_stack([np.polyval(np.polyder(line), time) for line in coefficients])
    wanted = np.array([0.0, 0.3, 1.7, 3.999, 4.0])
    found = interpolate(trajectory(time, place, velocity=velocity), wanted)
    np.testing.assert_allclose(
        found.place, np.column_stack([np.polyval(line, wanted) for line in coefficients]), atol=1e-12
    )


def test_accelerated_motion_without_velocities_is_met_exactly_where_a_straight_line_is_wrong() -> None:
    time = np.arange(0.0, 5.0, 1.0)
    place = np.column_stack([0.5 * time**2, time, 0.0 * time])
    found = interpolate(trajectory(time, place), np.array([2.5]))
    # a straight line is wrong by a dt²/8 = 0.125 m at 1 m/s² and 1 Hz
    assert place[2:4, 0].mean() - found.place[0, 0] == pytest.approx(0.125, abs=1e-12)
    assert found.place[0, 0] == pytest.approx(0.5 * 2.5**2, abs=1e-12)


def test_geographic_velocities_are_metres_per_second() -> None:
    # on a meridian arc of constant speed: 1 m/s northwards, epochs 10 s apart
    metres_per_radian = 6_378_137.0 * (1 - 0.00669437999014) / (1 - 0.00669437999014 * np.sin(0.9) ** 2) ** 1.5 + 100.0
    time = np.array([0.0, 10.0])
    place = np.column_stack([[0.2, 0.2], 0.9 + time / metres_per_radian, [100.0, 100.0]])
    velocity = np.tile([0.0, 1.0, 0.0], (2, 1))
    found = interpolate(epochs("t", np.arange(2), time=time, place=place, velocity=velocity), np.array([5.0]))
    assert (found.place[0, 1] - 0.9) * metres_per_radian == pytest.approx(5.0, abs=1e-4)


RADIUS, SPEED = 200.0, 20.0
"""Of a turn of an aeroplane, m and m/s."""


def turn(time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return places and velocities on a level circle: as closed a form as a straight line, but never straight."""
    angle = SPEED / RADIUS * time
    height = np.full_like(angle, 100.0)
    place = np.column_stack([RADIUS * np.cos(angle), RADIUS * np.sin(angle), height])
    return place, np.column_stack([-SPEED * np.sin(angle), SPEED * np.cos(angle), 0.0 * angle])


def test_a_turn_flown_at_one_epoch_a_second_is_met_to_a_tenth_of_a_millimetre() -> None:
    time, wanted = np.arange(0.0, 60.0), np.arange(0.0, 59.0, 0.13)
    place, velocity = turn(time)
    found = interpolate(trajectory(time, place, velocity=velocity), wanted)
    # Hermite's cubic is wrong by dt^4/384 of the fourth derivative at most, v^4/R^3 on a circle; 0.25 m a straight line
    bound = SPEED**4 / RADIUS**3 / 384.0
    missed = np.linalg.norm(found.place - turn(wanted)[0], axis=1)
    assert 0.5 * bound < missed.max() < bound < 1e-4
    without = interpolate(trajectory(time, place), wanted)
    assert np.linalg.norm(without.place - turn(wanted)[0], axis=1).max() > 20.0 * bound


@pytest.mark.parametrize("wrong", [np.diag([1.0, -1.0, 1.0]), np.eye(3)[[1, 0, 2]], 3.6 * np.eye(3), 0.0 * np.eye(3)])
def test_velocities_along_other_axes_or_in_another_unit_are_said_and_not_used(wrong: np.ndarray) -> None:
    time = np.arange(0.0, 60.0)
    place, velocity = turn(time)
    given = trajectory(time, place, velocity=velocity @ wrong.T)
    used, (said,) = without_contradicting_velocities(given)
    assert np.isnan(used.velocity).all()
    assert said.where.startswith("t.pos:")
    assert "m from where it is: they are along other axes or in another unit" in said.text


def test_noise_of_positions_and_standing_still_contradict_no_velocities() -> None:
    random = np.random.default_rng(3)
    time = np.arange(0.0, 60.0, 0.2)
    for place, velocity in (turn(time), (np.zeros((300, 3)), np.zeros((300, 3)))):
        given = trajectory(time, place + 0.05 * random.normal(size=place.shape), velocity=velocity)
        assert without_contradicting_velocities(given) == (given, ())


def test_attitudes_turn_the_short_way() -> None:
    time = np.array([0.0, 1.0])
    angles = np.radians([[2.0, -3.0, 350.0], [4.0, 1.0, 20.0]])
    wanted = np.array([0.25, 0.5])
    found = interpolate(trajectory(time, np.zeros((2, 3)), angles=angles), wanted)
    slerp = Slerp(time, Rotation.from_matrix(rotation_from_navigation(angles)))
    np.testing.assert_allclose(found.rotation, slerp(wanted).as_matrix(), atol=1e-14)


def test_events_in_gaps_and_outside_have_no_place() -> None:
    time = np.array([0.0, 1.0, 2.0, 3.0, 7.0, 8.0])
    found = interpolate(trajectory(time, np.zeros((6, 3))), np.array([-0.1, 2.5, 3.0, 5.0, 7.0, 8.1]))
    assert np.isnan(found.place[:, 0]).tolist() == [True, False, False, True, False, True]
    assert found.gap[3] == 4.0
    assert np.isnan(found.gap[[0, 5]]).all()


def test_a_clock_that_jumps_back_is_named_with_its_line() -> None:
    said = time_complaints(trajectory(np.array([0.0, 1.0, 0.5, 2.0, 2.0]), np.zeros((5, 3))))
    assert [entry.line for entry in said] == [12, 14]
    assert "0.500 s before the one above it: the clock has jumped" in said[0].message
    assert "same time as the one above" in said[1].message


def test_offsets_are_metres_along_east_north_up() -> None:
    place = np.array([[0.17, 0.93, 100.0]])
    north = moved(place, np.array([[0.0, 10.0, 0.0]]), is_geographic=True) - place
    east = moved(place, np.array([[10.0, 0.0, 0.0]]), is_geographic=True) - place
    up = moved(place, np.array([[0.0, 0.0, 10.0]]), is_geographic=True) - place
    # radii of curvature of WGS 84 at this latitude, in metres: Geod gives the same lengths
    from pyproj import Geod

    geod = Geod(ellps="WGS84")
    for shift, azimuth in ((north, 0.0), (east, 90.0)):
        start, end = np.degrees(place[0]), np.degrees(place[0] + shift[0])
        forward, _, length = geod.inv(start[0], start[1], end[0], end[1])
        # Geod measures on the ellipsoid, 100 m below
        assert length == pytest.approx(10.0, abs=3e-4)
        assert forward == pytest.approx(azimuth, abs=1e-4)
    np.testing.assert_allclose(up[0], [0.0, 0.0, 10.0], atol=1e-8)
