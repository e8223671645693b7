"""Inertial data with positions: flights whose truth is known, a walk with epochs left out, and what people mistake."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from cli.command_line import orip
from reference.published_data import REFERENCE_DATA
from scipy.spatial.transform import Rotation
from support.json_schemas import schema_faults
from support.long_cases import every
from trajectory.inertial_flight import (
    GRAVITY,
    LEVER,
    LEVER_ARM,
    MEMS,
    START,
    TACTICAL,
    Flight,
    flight,
    observed,
    written,
)

from orip.records.epochs import SECONDS_PER_WEEK
from orip.stations.inertial.alignment import align
from orip.stations.inertial.files import ImuForm, read_imu
from orip.stations.inertial.samples import Fixes, ImuNoise, ImuSamples, LocalGravity, Observed, normal_gravity
from orip.stations.inertial.smoother import smooth, state_times
from orip.stations.inertial.solution import Trajectory
from orip.stations.receiver_files import read_rtklib_pos, read_sbet
from orip.structs import replace

pytest.importorskip("gtsam", reason="pip install 'orip[ins]'")

WALK = REFERENCE_DATA / "gnss" / "walk"
NOTHING = ImuNoise(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


@pytest.fixture(scope="module")
def truth() -> Flight:
    return flight(strips=2, straight=20.0, rate=100.0)


@pytest.fixture(scope="module")
def sampled_often() -> Flight:
    return flight(strips=2, straight=20.0)


def errors(found: Trajectory, truth: Flight) -> tuple[np.ndarray, np.ndarray]:
    """Return errors of places, m, and of attitudes, radians about the axes of the body."""
    at = np.searchsorted(truth.time, found.time - 1e-6)
    turned = np.swapaxes(truth.rotation[at], 1, 2) @ found.rotation
    return found.place - truth.place[at], Rotation.from_matrix(turned).as_rotvec()


def standardised(found: Trajectory, truth: Flight) -> tuple[np.ndarray, np.ndarray]:
    place, attitude = errors(found, truth)
    return (
        place / np.sqrt(np.diagonal(found.place_covariance, axis1=1, axis2=2)),
        attitude / np.sqrt(np.diagonal(found.attitude_covariance, axis1=1, axis2=2)),
    )


def test_gravity_is_that_of_the_tables():
    # GRS 80: equator and pole (Moritz 2000), and 45 degrees
    for latitude, value in ((0.0, 9.7803267715), (90.0, 9.8321863685), (45.0, 9.806199203)):
        assert normal_gravity(np.radians(latitude), 0.0) == pytest.approx(value, abs=2e-9)
    assert normal_gravity(0.8, 0.0) - normal_gravity(0.8, 1000.0) == pytest.approx(3.085e-3, abs=3e-6)
    # the vertical turns by a second of arc in 30.9 m
    down = LocalGravity(0.8, 0.0).at(np.array([0.0, 30.9, 0.0]))
    assert np.degrees(down[1] / down[2]) * 3600.0 == pytest.approx(1.0, abs=0.01)


def test_pieces_between_two_times_are_those_of_the_samples():
    time = np.arange(0.0, 1.0, 0.1)
    ramp = np.column_stack([time, 2.0 * time, 0.0 * time])
    force, _, duration = ImuSamples(time, ramp, ramp).pieces(0.13, 0.48)
    assert duration.sum() == pytest.approx(0.35)
    assert len(duration) == 4
    assert force[:, 0] @ duration == pytest.approx((0.48**2 - 0.13**2) / 2.0)


def test_states_stand_at_fixes_at_times_wanted_and_once_a_second():
    time = np.array([0.0, 1.0, 4.0])
    unknown = np.full((3, 3), np.nan)
    times, fix = state_times(Fixes(time, unknown, unknown, unknown, unknown), np.array([-5.0, 1.25, 3.0, 99.0]))
    np.testing.assert_allclose(times, [0.0, 1.0, 1.25, 2.125, 3.0, 4.0])
    assert fix.tolist() == [0, 1, -1, -1, -1, 2]


def test_without_errors_the_truth_is_found(sampled_often):
    """The rotation of the Earth, the curvature of its surface and lever arms are all in the truth."""
    truth = sampled_often
    imu, fixes = observed(truth, NOTHING, np.random.default_rng(0), deviation=(1e-9, 1e-9, 1e-9))
    said = np.broadcast_to(np.diag([4e-4, 4e-4, 16e-4]), fixes.covariance.shape).copy()
    found = smooth(
        Observed(imu, replace(fixes, covariance=said), GRAVITY, TACTICAL, LEVER_ARM), estimates_noise=False
    ).trajectory
    place, attitude = errors(found, truth)
    # samples 200 times a second, by the trapezoidal rule
    assert np.abs(place).max() < 5e-4
    assert np.degrees(np.abs(attitude).max()) < 5e-4


@pytest.mark.parametrize("noise", [MEMS, TACTICAL], ids=["mems", "tactical"])
def test_the_first_attitude_without_a_magnetometer(truth, noise):
    imu, fixes = observed(truth, noise, np.random.default_rng(5))
    found = align(Observed(imu, fixes, GRAVITY, noise, LEVER_ARM))
    at = np.searchsorted(truth.time, found.time - 1e-6)
    error = Rotation.from_matrix(truth.rotation[at].T @ found.rotation).magnitude()
    assert np.degrees(error) < 25.0  # from where the graph converges


def within(values: np.ndarray, runs: int) -> None:
    """Errors within a run are correlated over some seconds: a run has some ten independent ones of each coordinate."""
    rms = np.sqrt(np.mean(values**2, axis=0))
    tolerance = 4.0 / np.sqrt(2.0 * 10.0 * runs)
    assert (np.abs(rms - 1.0) < tolerance).all(), rms


@pytest.mark.parametrize("noise", [MEMS, TACTICAL], ids=["mems", "tactical"])
def test_errors_are_as_large_as_is_said(truth, noise):
    both = []
    for run in range(2):
        imu, fixes = observed(truth, noise, np.random.default_rng(run))
        both.append(
            standardised(
                smooth(Observed(imu, fixes, GRAVITY, noise, LEVER_ARM), estimates_noise=False).trajectory, truth
            )
        )
    within(np.concatenate([place for place, _ in both]), 2)
    within(np.concatenate([attitude for _, attitude in both]), 2)


@pytest.mark.long
@pytest.mark.timeout(1800)
@pytest.mark.parametrize("noise", [MEMS, TACTICAL], ids=["mems", "tactical"])
def test_errors_of_a_hundred_flights(noise):
    whole = flight()
    both = []
    for run in range(100):
        imu, fixes = observed(whole, noise, np.random.default_rng(run))
        both.append(
            standardised(
                smooth(Observed(imu, fixes, GRAVITY, noise, LEVER_ARM), estimates_noise=False).trajectory, whole
            )
        )
    for values in zip(*both, strict=True):
        rms = np.sqrt(np.mean(np.concatenate(values) ** 2, axis=0))
        assert ((rms > 0.93) & (rms < 1.07)).all(), rms
        # no bias at p < 0.01, of six means: the means of runs are independent
        means = np.array([run.mean(axis=0) for run in values])
        t = means.mean(axis=0) / (means.std(axis=0, ddof=1) / np.sqrt(len(means)))
        assert np.abs(t).max() < 3.2, t


def test_noise_that_is_said_too_small_is_found(truth):
    imu, fixes = observed(truth, MEMS, np.random.default_rng(3), scale=6.0)
    wide = replace(fixes, covariance=fixes.covariance * 9.0)
    found = smooth(Observed(imu, wide, GRAVITY, MEMS, LEVER_ARM)).trajectory
    assert 3.0 < found.factors.unit < 10.0
    assert found.factors.position == pytest.approx(1.0 / 3.0, rel=0.25)
    within(standardised(found, truth)[0], 1)


def test_noise_of_each_kind_of_sensor_is_estimated_by_itself(sampled_often):
    """Beside such accelerometers gyroscopes say little: the logarithm of their factor scatters by 0.3."""
    given = replace(MEMS, gyro=MEMS.gyro * 8.0, accelerometer=MEMS.accelerometer * 50.0)
    imu, fixes = observed(sampled_often, given, np.random.default_rng(4), interval=0.25, speed=0.05)
    found = smooth(Observed(imu, fixes, GRAVITY, MEMS, LEVER_ARM)).trajectory.factors
    assert abs(np.log(found.gyro / 8.0)) < 0.9
    assert found.accelerometer == pytest.approx(50.0, rel=0.25)


@pytest.mark.parametrize("runs", every(2, [1, 3]))
def test_a_good_unit_that_is_six_times_noisier(runs):
    """It has a redundancy of 8 in such a flight: the standard deviation of a factor is 1 / sqrt(2 r), 0.25 at first."""
    whole, found = flight(rate=100.0), []
    for run in range(runs):
        imu, fixes = observed(whole, TACTICAL, np.random.default_rng(run), scale=6.0)
        solved = smooth(Observed(imu, fixes, GRAVITY, TACTICAL, LEVER_ARM)).trajectory
        assert 3.0 < solved.factors.unit < 12.0
        found.append(standardised(solved, whole))
    within(np.concatenate([place for place, _ in found]), runs)
    within(np.concatenate([attitude for _, attitude in found]), runs)


def test_redundancy_and_unknowns_are_the_observations(truth):
    imu, fixes = observed(truth, MEMS, np.random.default_rng(4))
    solved = smooth(Observed(imu, fixes, GRAVITY, MEMS, LEVER_ARM), estimates_noise=False)
    residual, covariance = solved.unit_residuals()
    assert np.sum(residual**2) == pytest.approx(solved.square_sums()["unit"], rel=1e-6)
    arm = np.hstack([np.cross(np.eye(3), LEVER_ARM).T, np.eye(3)])
    turned = solved.trajectory.rotation @ arm
    antenna = turned @ solved.trajectory.chain.covariance[:, :6, :6] @ np.swapaxes(turned, 1, 2)
    given = np.trace(np.linalg.solve(fixes.covariance, antenna), axis1=1, axis2=2)
    # of the beginning, 15 observations are at most redundant
    rest = given.sum() - np.einsum("kii->", covariance)
    assert 0.0 < rest < 15.0
    assert (np.linalg.eigvalsh(covariance) > -1e-6).all()


# a genuine walk


def walk(*words: str, left_out: tuple[float, float] = (0.0, 0.0)) -> tuple[ImuSamples, Fixes]:
    from orip.stations.inertial.processing import local_fixes

    if not WALK.exists():
        pytest.skip("the folder gnss/walk is not in ../shared/reference-data beside the repository")
    imu = read_imu(WALK / "imu.csv.gz", "imu", ImuForm(force="g", mount=(180.0, 0.0, -90.0), shift=-315_964_800.0))
    assert not imu.complaints
    positions = read_rtklib_pos(WALK / "gnss.pos", "pos").value
    inside = (positions.time > imu.value.time[0]) & (positions.time < imu.value.time[-1])
    positions = replace(
        positions, time=positions.time[inside], place=positions.place[inside], covariance=positions.covariance[inside],
        velocity=positions.velocity[inside],
        quality=tuple(word for word, take in zip(positions.quality, inside, strict=True) if take),
    )  # fmt: skip
    is_float = np.array([word != "fixed" for word in positions.quality])
    covariance = np.where(is_float[:, None, None], 0.09 * np.eye(3), positions.covariance)
    return imu.value, local_fixes(replace(positions, covariance=covariance))[0]


WALKED = ImuNoise(np.radians(0.0038), 70e-6 * 9.80665, 1e-5, 1e-4, np.radians(0.5), 0.1)


def left_out(seconds: list[float], around: float = 1e9) -> tuple[np.ndarray, np.ndarray]:
    """Return errors (k, 3) of ten seconds of fixes that were left out, and whether all are inside three deviations."""
    imu, fixes = walk()
    found_errors, inside = [], []
    for second in seconds:
        begin = fixes.time[0] + second
        out = (fixes.time >= begin) & (fixes.time < begin + 10.0)
        near = ~out & (np.abs(fixes.time - begin) < around)
        kept = Fixes(*(getattr(fixes, name)[near] for name in fixes.__struct_fields__))
        lever = np.array([0.0, 0.05, 0.0])
        found = smooth(Observed(imu, kept, LocalGravity(0.7, 1601.0), WALKED, lever), fixes.time[out]).trajectory
        at = np.searchsorted(found.time, fixes.time[out])
        error = found.place[at] + found.rotation[at] @ lever - fixes.place[out]
        variance = found.place_covariance[at] + fixes.covariance[out]
        inside.append((np.abs(error) < 3.0 * np.sqrt(np.diagonal(variance, axis1=1, axis2=2))).all(axis=1))
        found_errors.append(error)
    return np.concatenate(found_errors), np.concatenate(inside)


def test_ten_seconds_of_a_walk_that_were_left_out():
    error, inside = left_out([50.0], around=20.0)
    assert len(error) >= 38
    assert np.sqrt(np.mean(np.sum(error**2, axis=1))) < 0.25
    assert inside.mean() >= 0.9


@pytest.mark.long
@pytest.mark.timeout(1800)
def test_ten_seconds_of_a_walk_left_out_at_ten_places():
    error, inside = left_out([13.0, 20.0, 27.0, 34.0, 41.0, 48.0, 55.0, 62.0, 70.0, 77.0])
    assert np.sqrt(np.mean(np.sum(error**2, axis=1))) < 0.25
    assert inside.mean() >= 0.95


# the command


@pytest.fixture(scope="module")
def flown(truth, tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("flown")
    written(folder, truth, *observed(truth, MEMS, np.random.default_rng(1)))
    return folder


def test_files_of_a_trajectory(flown, truth):
    said = orip(flown, "imu", "imu.csv.gz", "flight.pos", LEVER, "--json")
    assert said.code == 0, said.err
    document = json.loads(said.out)
    assert schema_faults(document) == []
    assert document["warnings"] == []
    assert document["time_system"] == "gps"
    found = read_sbet(flown / "imu.sbet", "s", flown / "imu.smrmsg", "d")
    assert not found.complaints
    time = found.value.time + 1316 * SECONDS_PER_WEEK - START
    at = np.clip(np.searchsorted(truth.time, time - 1e-6), 0, len(truth.time) - 1)
    assert np.abs(truth.time[at] - time).max() < 1e-3
    swap = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
    expected = Rotation.from_matrix(swap @ truth.rotation[at]).as_euler("ZYX")[:, ::-1]
    difference = np.angle(np.exp(1j * (found.value.angles - expected)))
    assert np.degrees(np.abs(difference[:, :2]).max()) < 0.1
    assert np.degrees(np.abs(difference[:, 2]).max()) < 0.4
    ratio = np.sqrt(np.mean((difference / found.value.angle_error) ** 2, axis=0))
    # the course has one error for the whole flight
    assert (ratio < [1.6, 1.6, 3.0]).all(), ratio
    assert (ratio[:2] > 0.6).all(), ratio
    np.testing.assert_allclose(found.value.velocity, truth.velocity[at], atol=0.1)


def test_what_people_mistake_is_said(tmp_path):
    truth = flight(strips=1, straight=12.0, rate=50.0)
    imu, fixes = observed(truth, MEMS, np.random.default_rng(1))
    written(tmp_path, truth, imu, fixes)
    for change, words, text in [
        ({}, ("--force-unit", "g"), "they are probably in m/s²"),
        ({}, ("--columns", "time,fx"), "write each of time,fx,fy,fz,wx,wy,wz once"),
        ({}, ("--noise", "good"), "write one of mems, tactical, navigation"),
        ({}, ("--lever-arm", "1,2"), "write three numbers"),
        ({}, ("--time", "local"), "write one of gps, week, unix-gps, unix-utc"),
        ({}, ("-o", "flight.pos"), "is a file that is read; name another"),
        ({"force": 1 / 9.80665}, (), "they are probably in g: --force-unit g"),
        ({"late": 86400.0}, (), "samples and positions have 0 s in common"),
    ]:
        if change:
            written(tmp_path, truth, imu, fixes, **change)
        said = orip(tmp_path, "imu", "imu.csv.gz", "flight.pos", *words)
        assert said.code != 0
        assert text in said.err
        assert not list(tmp_path.glob("*.s*"))
    degrees = replace(imu, rate=np.degrees(imu.rate))
    written(tmp_path, truth, degrees, fixes)
    said = orip(tmp_path, "imu", "imu.csv.gz", "flight.pos", LEVER)
    assert "--rate-unit deg/s" in said.err
    slow = replace(imu, rate=np.radians(imu.rate))
    written(tmp_path, truth, slow, fixes)
    said = orip(tmp_path, "imu", "imu.csv.gz", "flight.pos", LEVER)
    assert "angular rates are in rad/s" in said.err or "all fits if" in said.err, said.err


def test_a_time_offset_is_estimated_and_said(tmp_path, truth):
    written(tmp_path, truth, *observed(truth, MEMS, np.random.default_rng(1)), late=-0.03)
    said = orip(tmp_path, "imu", "imu.csv.gz", "flight.pos", LEVER, "--json")
    assert said.code == 0, said.err
    (warning,) = [one for one in json.loads(said.out)["warnings"] if one["code"] == "time-offset"]
    assert float(warning["text"].split("best ")[1].split(" ")[0]) == pytest.approx(0.03, abs=0.006)


def test_axes_of_the_unit_that_are_not_those_of_the_body(tmp_path, truth):
    imu, fixes = observed(truth, MEMS, np.random.default_rng(1))
    turned = replace(imu, force=imu.force[:, [1, 0, 2]], rate=imu.rate)
    written(tmp_path, truth, turned, fixes)
    said = orip(tmp_path, "imu", "imu.csv.gz", "flight.pos", LEVER)
    assert said.code == 0
    assert "axes are exchanged: what is called the force right is forward, forward is right beside" in said.err


def table_of(count: int) -> str:
    return "".join(f"{n / 100},0,0,-9.8,0,0,0\n" for n in range(count))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "there are 0 samples"),
        ("1,2,3\n" * 200, "3 columns where 7 are needed"),
        ("1 0 0 -9.8 0 0 0\n" * 200, "is not later than the one before it"),
        ("\n".join(f"{n / 100} 0 0 -9.8 0 0 0" for n in range(200)) + "\n9 0 0 -9.8 0 0 0", "s without samples"),
        ("\n".join(f"{n / 100} 0 0 -9.8 0 0 nan" for n in range(200)), "not finite"),
        ("\n".join(f"{n / 100} 0 0 -9.8e999 0 0 0" for n in range(200)), "not finite"),
        ("\n".join(f"{n / 100} 0 0 -9.8e300 0 0 0" for n in range(200)), "larger than anything"),
        ("\n".join(f"{n / 100} 0 0 -9.8 0 0 99" for n in range(200)), "--rate-unit deg/s"),
        ("\n".join(f"{n / 100} 0 0 -9.8 0 0 0" for n in range(200)) + "\nx y z 1 2 3 4", "is no row of numbers"),
        (table_of(200) + "2,0,0,-9.8,0,0,0,4", "8 columns where the rows before it have 7"),
        (table_of(200) + "2,0,0,-9.   8,0,0,0", "a.csv:201: '2,0,0,-9.   8,0,0,0' is no row of numbers"),
        (table_of(200) + "2,0,0,-9.8,0,276031,0", "sample 201 has an angular rate of 276031 rad/s"),
        (table_of(200) + "2,0,-9e7,-9.8,0,0,0", "sample 201 has a specific force of 9e+07 m/s²"),
    ],
)
def test_what_is_no_table_of_a_unit(tmp_path, text, said):
    (tmp_path / "a.csv").write_text(text)
    found = read_imu(tmp_path / "a.csv", "a.csv", ImuForm())
    assert any(said in str(fault) for fault in found.complaints), found.complaints
