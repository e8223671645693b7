"""The filter alone, its innovations, and errors that a flight has in common, against flights whose truth is known."""

from __future__ import annotations

import numpy as np
import pytest
from cli.command_line import orip
from scipy.spatial.transform import Rotation
from scipy.stats import chi2
from support.json_schemas import schema_faults
from support.long_cases import every
from trajectory.inertial_flight import (
    EARTH,
    GRAVITY,
    LATITUDE,
    LEVER,
    LEVER_ARM,
    MEMS,
    TACTICAL,
    Flight,
    flight,
    observed,
    written,
)

from orip.stations.gnss.raw_files import moment
from orip.stations.inertial.alignment import align, course_deviation, level_deviation
from orip.stations.inertial.common_errors import common_errors
from orip.stations.inertial.findings import Named, findings, fix_statistics
from orip.stations.inertial.samples import EARTH_RADIUS, Fixes, ImuNoise, ImuSamples, Observed, normal_gravity
from orip.stations.inertial.smoother import filter_as, smooth
from orip.stations.inertial.solution import Solved
from orip.structs import replace

pytest.importorskip("gtsam", reason="pip install 'orip[ins]'")

NAMED = Named("imu", "pos", 0.0)


@pytest.fixture(scope="module")
def truth() -> Flight:
    return flight(strips=2, straight=20.0, rate=100.0)


def solved(imu: ImuSamples, fixes: Fixes, noise: ImuNoise = MEMS, **given: object) -> Solved:
    lever = given.get("lever", LEVER_ARM)
    return smooth(Observed(imu, fixes, GRAVITY, noise, lever), estimates_noise=bool(given.get("estimates", False)))


@pytest.mark.parametrize("noise", [MEMS, TACTICAL], ids=["mems", "tactical"])
def test_the_filter_is_as_far_from_the_truth_as_it_says(truth, noise):
    """Errors within a run are correlated: of a place some twelve are independent, of an attitude some three.

    Before manoeuvres a tilt is what the bias of an accelerometer is, one for the flight.
    """
    place, attitude, innovation = [], [], []
    for run in range(2):
        found = solved(*observed(truth, noise, np.random.default_rng(run)), noise)
        filtered = filter_as(found)
        states = filtered.states
        # before the turns the attitude is not known to degrees, and nothing is linear
        known = np.trace(states.attitude_covariance, axis1=1, axis2=2) < np.radians(5.0) ** 2
        at = np.searchsorted(truth.time, states.time[known] - 1e-6)
        turned = np.swapaxes(truth.rotation[at], 1, 2) @ states.rotation[known]
        rotation = Rotation.from_matrix(turned).as_rotvec()
        place.append((states.place[known] - truth.place[at]) / deviations(states.place_covariance[known]))
        attitude.append(rotation / deviations(states.attitude_covariance[known]))
        tested = fix_statistics(found, filtered)
        innovation.append(tested[np.isfinite(tested)])
        # what the smoother has besides makes it better
        smoothed = found.trajectory
        same = np.searchsorted(states.time, smoothed.time[5:-1] - 1e-6)
        assert (deviations(smoothed.place_covariance[5:-1]) < deviations(states.place_covariance[same])).all()
    for values, independent in ((place, 12), (attitude, 3)):
        rms = np.sqrt(np.mean(np.concatenate(values) ** 2))
        assert abs(rms - 1.0) < 4.0 / np.sqrt(2.0 * 3 * independent * 2), rms
    tested = np.concatenate(innovation)
    # innovations are independent of each other: their sum of squares is chi-squared with 3 for each
    low, high = chi2.ppf([1e-4, 1.0 - 1e-4], 3 * len(tested))
    assert low < tested.sum() < high


def deviations(covariance: np.ndarray) -> np.ndarray:
    return np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))


def test_a_wrong_position_is_named_with_its_size(truth):
    imu, fixes = observed(truth, MEMS, np.random.default_rng(8))
    fixes.place[50] += [0.3, -0.4, 0.0]
    found = solved(imu, fixes)
    filtered = filter_as(found)
    (warning,) = [one for one in findings(found, filtered, NAMED) if one.code == "wrong-positions"]
    assert moment(fixes.time[50]) in warning.text
    assert warning.text.count("standard deviation") == 1
    assert " by 0.5" in warning.text or " by 0.4" in warning.text


@pytest.mark.parametrize("seed", every(3, [20, 21, 22]))
def test_nothing_is_said_of_what_is_right(truth, seed):
    found = solved(*observed(truth, MEMS, np.random.default_rng(seed)), estimates=True)
    assert list(findings(found, filter_as(found), NAMED)) == []


def test_a_wrong_lever_arm_is_estimated(truth):
    imu, fixes = observed(truth, MEMS, np.random.default_rng(2))
    wrong = np.array([0.35, -0.15, 0.1])
    found = solved(imu, fixes, lever=LEVER_ARM + wrong, estimates=True)
    common = common_errors(found)
    assert common.shift is None
    value, deviation = common.lever_arm
    assert (np.abs(value + wrong) < 4.0 * deviation + 0.02).all(), (value, deviation)
    assert (deviation < 0.1).all()
    (warning,) = [one for one in findings(found, filter_as(found), NAMED) if one.code == "lever-arm"]
    assert "add" not in warning.text
    assert "--lever-arm=0." in warning.text


@pytest.mark.parametrize("late", [0.02, -0.01])
def test_a_time_offset_is_told_from_a_lever_arm(truth, late):
    imu, fixes = observed(truth, MEMS, np.random.default_rng(3))
    common = common_errors(solved(replace(imu, time=imu.time - late), fixes, estimates=True))
    assert common.lever_arm is None or common.is_either
    value, deviation = common.shift
    assert abs(value - late) < 4.0 * deviation + 0.1 * abs(late)
    assert deviation < 0.005


@pytest.mark.parametrize("late", [0.12, -0.1])
def test_velocities_of_another_time_are_found(truth, late):
    imu, fixes = observed(truth, MEMS, np.random.default_rng(5), speed=0.05, late=late)
    found = solved(imu, fixes, estimates=True)
    common = common_errors(found)
    value, deviation = common.delay
    assert abs(value - late) < 4.0 * deviation
    assert deviation < 0.01
    assert found.graph.delay == pytest.approx(value, abs=0.002)
    assert (common.shift, common.lever_arm) == (None, None)
    assert found.trajectory.factors.velocity == pytest.approx(1.0, abs=0.25)
    (warning,) = findings(found, filter_as(found), NAMED)
    assert warning.code == "velocity-delay"
    # as given: it is said, and nothing else is made of it
    given = solved(imu, fixes)
    assert given.graph.delay == 0.0
    assert common_errors(given).delay[0] == pytest.approx(late, abs=0.02)


def test_velocities_in_time_stay_as_they_are(truth):
    for seed in range(4):
        found = solved(*observed(truth, MEMS, np.random.default_rng(30 + seed), speed=0.05), estimates=True)
        assert found.graph.delay == 0.0
        assert common_errors(found).delay is None


def test_forward_axes_that_do_not_go_forward_are_said(truth):
    imu, fixes = observed(truth, MEMS, np.random.default_rng(3))
    for yaw, side in ((90.0, "left"), (-90.0, "right")):
        turn = Rotation.from_euler("z", yaw, degrees=True).as_matrix()
        turned = replace(imu, force=imu.force @ turn.T, rate=imu.rate @ turn.T)
        found = solved(turned, fixes, lever=turn @ LEVER_ARM)
        (warning,) = findings(found, filter_as(found), NAMED)
        assert warning.code == "mount"
        assert f"degrees to the {side} of where it goes" in warning.text
        assert float(warning.text.split("points ")[1].split(" ")[0]) == pytest.approx(90.0, abs=6.0)
    turn = np.diag([1.0, -1.0, -1.0])
    found = solved(replace(imu, force=imu.force @ turn, rate=imu.rate @ turn), fixes, lever=turn @ LEVER_ARM)
    (warning,) = findings(found, filter_as(found), NAMED)
    assert "17" in warning.text
    assert "degrees from the vertical" in warning.text


def test_velocities_are_those_of_the_antenna(truth):
    """The antenna swings by 0.4 m/s in turns: taken for velocities of the unit they would not fit at all."""
    imu, fixes = observed(truth, TACTICAL, np.random.default_rng(4), speed=0.02)
    found = solved(imu, fixes, TACTICAL, estimates=True)
    assert found.trajectory.factors.velocity == pytest.approx(1.0, abs=0.15)
    without = solved(imu, replace(fixes, velocity=np.full_like(fixes.velocity, np.nan)), TACTICAL)
    known = solved(imu, fixes, TACTICAL)
    assert (deviations(known.trajectory.velocity_covariance) < deviations(without.trajectory.velocity_covariance)).all()


def standing(seconds: float, noise: ImuNoise, random: np.random.Generator) -> tuple[ImuSamples, Fixes, np.ndarray]:
    """Return a unit and an antenna that stand, and the attitude of the unit."""
    time = np.arange(0.0, seconds, 0.01)
    swap = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
    rotation = swap @ Rotation.from_euler("ZYX", [1.1, 0.02, -0.03]).as_matrix()
    body = Flight(
        time, np.zeros((len(time), 3)), np.zeros((len(time), 3)), np.broadcast_to(rotation, (len(time), 3, 3)),
        np.tile(-rotation.T @ GRAVITY.at(np.zeros(3)), (len(time), 1)), np.tile(rotation.T @ EARTH, (len(time), 1)),
    )  # fmt: skip
    return *observed(body, noise, random), rotation


def test_what_stands_has_no_velocity_and_a_gyrocompass_gives_the_course():
    good = ImuNoise(np.radians(3e-5), 5e-5, np.radians(1e-8), 1e-7, np.radians(1e-3) / 3600.0 * 10.0, 3e-4)
    errors = []
    for seed in range(5):
        imu, fixes, rotation = standing(120.0, good, np.random.default_rng(seed))
        first = align(Observed(imu, fixes, GRAVITY, good, LEVER_ARM))
        error = Rotation.from_matrix(rotation.T @ first.rotation).as_rotvec()
        errors.append(error[2] / first.deviation)
        assert np.degrees(first.deviation) < 0.5
        found = solved(imu, fixes, good)
        assert found.trajectory.standing >= 110
        assert np.abs(found.trajectory.velocity).max() < 0.01
    assert np.sqrt(np.mean(np.square(errors))) < 2.5  # of five
    # a small unit cannot: its biases are larger than the rotation of the Earth
    imu, fixes, _ = standing(60.0, MEMS, np.random.default_rng(1))
    assert np.isfinite(align(Observed(imu, fixes, GRAVITY, MEMS, LEVER_ARM)).change)


def test_what_flies_does_not_stand(truth):
    assert solved(*observed(truth, MEMS, np.random.default_rng(1))).trajectory.standing == 0


def test_theory_of_the_first_attitude():
    """Yom 2000, chapter 4.3: figures of the thesis."""
    drift = np.radians(0.01) / 3600.0
    assert np.degrees(course_deviation(drift, np.radians(50.0))) == pytest.approx(0.0593, abs=5e-5)
    assert np.degrees(level_deviation(50e-6 * 9.80665)) * 3600.0 == pytest.approx(10.3, abs=0.05)
    period = 2.0 * np.pi * np.sqrt(EARTH_RADIUS / normal_gravity(LATITUDE, 0.0))
    assert period / 60.0 == pytest.approx(84.4, abs=0.1)


def test_the_command_writes_that_of_the_filter(tmp_path, truth):
    written(tmp_path, truth, *observed(truth, MEMS, np.random.default_rng(1)))
    smoothed = orip(tmp_path, "imu", "imu.csv.gz", "flight.pos", LEVER, "--json").document
    said = orip(tmp_path, "imu", "imu.csv.gz", "flight.pos", LEVER, "--forward", "--json")
    assert said.code == 0, said.err
    assert schema_faults(said.document) == []
    assert (smoothed["forward"], said.document["forward"]) == (False, True)
    assert np.all(np.array(said.document["place_sd"]) > smoothed["place_sd"])
    assert 0.8 < said.document["innovations"] < 1.2
    text = orip(tmp_path, "imu", "imu.csv.gz", "flight.pos", LEVER, "--forward").err
    assert "filter   from the smoother" in text
    ratio = float(text.split("\n         ")[1].split(" ")[0]) if "\n         " in text else 1.0
    assert ratio > 0.0
    refused = orip(tmp_path, "imu", "imu.csv.gz", "flight.pos", "--forward", "--events", "imu.csv.gz")
    assert "need the smoother" in refused.err
