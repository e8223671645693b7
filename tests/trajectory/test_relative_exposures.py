"""Stations and differences of a smoothed trajectory, as independent observations, say what the smoother says."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from cli.command_line import orip
from pyproj import Proj, Transformer
from scipy.spatial.transform import Rotation
from support.long_cases import every
from trajectory.inertial_flight import (
    GRAVITY,
    HEIGHT,
    LATITUDE,
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

from orip.files.control.stations_text import read_differences, read_stations
from orip.geometry.ground_ellipsoid import geocentric_from_geographic, geographic_from_geocentric, place_axes
from orip.geometry.rotation import angles_from_rotation, rotation_from_angles
from orip.stations.inertial.differences import independent_poses
from orip.stations.inertial.samples import ImuNoise, Observed
from orip.stations.inertial.smoother import smooth
from orip.stations.inertial.solution import chain_of
from orip.stations.interpolation import WGS84

pytest.importorskip("gtsam")


def test_covariances_of_a_chain_are_those_of_the_whole_matrix():
    random = np.random.default_rng(1)
    count, size = 6, 4
    single = [[random.normal(size=(size if row == 0 else 2, size))] for row in range(count)]
    tied = [[random.normal(size=(size + 1, 2 * size))] for _ in range(count - 1)]
    rows = []
    for row, own in enumerate(single):
        rows.append(np.zeros((len(own[0]), count * size)))
        rows[-1][:, row * size : (row + 1) * size] = own[0]
    for row, both in enumerate(tied):
        rows.append(np.zeros((len(both[0]), count * size)))
        rows[-1][:, row * size : (row + 2) * size] = both[0]
    whole = np.vstack(rows)
    covariance = np.linalg.inv(whole.T @ whole).reshape(count, size, count, size)
    found = chain_of(single, tied)
    for first in range(count):
        for second in range(first, count):
            np.testing.assert_allclose(found.between(first, second), covariance[first, :, second], rtol=1e-8)


def joint_covariances(noise: ImuNoise) -> tuple[np.ndarray, np.ndarray]:
    """Return the covariances (n, 6, n, 6) of exposures of a flight, by independent observations and by the smoother."""
    truth = flight(strips=3, rate=100.0)
    imu, fixes = observed(truth, noise, np.random.default_rng(1))
    times = np.arange(17.05, truth.time[-1] - 3.0, 2.0)
    trajectory = smooth(Observed(imu, fixes, GRAVITY, noise, LEVER_ARM), times, estimates_noise=False).trajectory
    states = [int(np.argmin(np.abs(trajectory.time - time))) for time in times]
    found, count = independent_poses(trajectory, states), len(times)
    weight, said = np.zeros((count, 6, count, 6)), np.zeros((count, 6, count, 6))
    for row in range(count):
        weight[row, :, row] += np.linalg.inv(found.station[row])
    for row, covariance in enumerate(found.difference):
        if np.isfinite(covariance).all():
            tie = np.linalg.inv(covariance)
            for one, other, sign in ((0, 0, 1.0), (1, 1, 1.0), (0, 1, -1.0), (1, 0, -1.0)):
                weight[row + one, :, row + other] += sign * tie
    for first in range(count):
        for second in range(first, count):
            both = trajectory.chain.between(states[first], states[second])[:6, :6]
            one, other = (
                np.kron([[0.0, 1.0], [1.0, 0.0]], trajectory.rotation[states[row]]) for row in (first, second)
            )
            said[first, :, second] = one @ both @ other.T
            said[second, :, first] = said[first, :, second].T
    got = np.linalg.inv(weight.reshape(6 * count, -1)).reshape(said.shape)
    return got, said


def ratios(values: np.ndarray, expected: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values) / np.mean(expected)))


def apart(table: np.ndarray, lag: int, axis: int) -> np.ndarray:
    """Return variances of the differences of exposures that are so many apart."""
    one = np.arange(len(table) - lag)
    other = one + lag
    return table[one, axis, one, axis] + table[other, axis, other, axis] - 2.0 * table[one, axis, other, axis]


@pytest.mark.parametrize("noise", every(2, [MEMS, TACTICAL]), ids=["mems", "tactical"])
def test_all_together_are_as_precise_as_the_smoother_says(noise):
    got, said = joint_covariances(noise)
    rows = np.arange(len(got))
    for axis in range(6):
        assert ratios(got[rows, axis, rows, axis], said[rows, axis, rows, axis]) == pytest.approx(1.0, abs=0.06)
        # what all have in common, and what neighbours have: never promised much too well
        assert 0.9 < ratios(got[:, axis, :, axis], said[:, axis, :, axis]) < 1.5
        for lag in (1, 2, 5, 10):
            assert ratios(apart(got, lag, axis), apart(said, lag, axis)) > 0.85, (axis, lag)


def test_the_command_writes_stations_and_differences_of_a_project(tmp_path: Path) -> None:
    """They fit the truth by their own covariances, in a map projection."""
    truth = flight(strips=2, straight=20.0, rate=100.0)
    written(tmp_path, truth, *observed(truth, TACTICAL, np.random.default_rng(4), deviation=(0.03, 0.03, 0.03)))
    times = np.arange(18.05, truth.time[-1] - 3.0, 1.5)
    rows = "".join(f"P{row},{time + START:.4f}\n" for row, time in enumerate(times))
    (tmp_path / "events.csv").write_text("photo,time\n" + rows)
    (tmp_path / "orip.toml").write_text(PROJECT)
    words = ("imu", "imu.csv.gz", "flight.pos", LEVER, "--noise", "tactical", "--as-given", "--events", "events.csv")
    said = orip(tmp_path, *words)
    assert said.code == 0, said.err
    assert f"{len(times)} written to F.STA, their differences to F.REL" in said.err
    stations, differences = read_stations(tmp_path / "F.STA", "S"), read_differences(tmp_path / "F.REL", "R")
    assert stations.complaints == differences.complaints == ()
    assert len(stations.value) == len(times)
    assert len(differences.value) > len(times) / 2
    at = np.searchsorted(truth.time, times - 1e-6)
    place, attitude = grid_poses(truth, at)
    error = np.hstack([
        np.array([station.position for station in stations.value]) - place,
        np.array([station.angles for station in stations.value]) - angles_from_rotation(attitude),
    ])  # fmt: skip
    error[:, 3:] = np.angle(np.exp(1j * error[:, 3:]))
    # one run: stations are down-weighted for what they have in common, so that their errors are the smaller ones
    own = np.sqrt([np.diag(station.covariance) for station in stations.value])
    assert np.abs(error / own).max() < 4.0
    index = {station.photo: row for row, station in enumerate(stations.value)}
    chosen = [(index[line.first], index[line.second]) for line in differences.value]
    one, other = np.array(chosen).T
    moved = np.array([line.position for line in differences.value]) - (place[other] - place[one])
    turned = np.swapaxes(attitude[one], 1, 2) @ attitude[other]
    given = rotation_from_angles(np.array([line.angles for line in differences.value]))
    rotated = Rotation.from_matrix(given @ np.swapaxes(turned, 1, 2)).as_rotvec()
    errors = np.array([line.errors for line in differences.value])
    assert np.abs(np.hstack([moved, rotated]) / errors).max() < 4.0
    again = orip(tmp_path, *words)
    assert again.code != 0
    assert "give --replace" in again.err


PROJECT = """project = { name = "F", crs = "EPSG:25832" }
[[camera]]
name = "C35"
c = 35.0
sensor = { columns = 6000, rows = 4000, width = 36.0, height = 24.0 }
[[bundle]]
name = "MAIN"
measurement_precision = "0.5px"
"""


def grid_poses(truth: Flight, at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return places in UTM by pyproj, and rotations of photos that look down, turned by the meridian convergence."""
    origin = np.array([[0.2, LATITUDE, HEIGHT]])
    geocentric = geocentric_from_geographic(origin, WGS84) + truth.place[at] @ place_axes(origin)[0]
    geographic = geographic_from_geocentric(geocentric, WGS84)
    longitude, latitude = np.degrees(geographic[:, 0]), np.degrees(geographic[:, 1])
    east, north = Transformer.from_crs("EPSG:4258", "EPSG:25832", always_xy=True).transform(longitude, latitude)
    convergence = Proj("EPSG:25832").get_factors(longitude, latitude).meridian_convergence
    photo_in_body = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
    to_grid = Rotation.from_euler("z", np.asarray(convergence)[:, None], degrees=True).as_matrix()
    return np.column_stack([east, north, geographic[:, 2]]), to_grid @ truth.rotation[at] @ photo_in_body
