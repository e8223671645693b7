"""Velocities and angular rates of stations from a trajectory: signs, axes, and what their standard deviations promise.

The flight is a function of time, turned by scipy along the axes north, east, down; the truth are differences of it over
a moment.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from cli.command_line import orip
from pyproj import Geod, Proj
from scipy.spatial.transform import Rotation
from trajectory.inertial_flight import LEVER, START, TACTICAL, flight, observed, written
from trajectory.test_relative_exposures import PROJECT

from orip.files.control.stations_text import read_stations
from orip.records.control import Station
from orip.records.epochs import epochs
from orip.stations.interpolation import motions_at

ROLLING = PROJECT.replace("c = 35.0\n", "c = 35.0\nreadout = 0.03\n")
LONGITUDE, LATITUDE = 10.2, 50.0
EVENTS = np.arange(2.0, 38.0, 0.734)
ENU = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
"""North, east, down to east, north, up."""


def angles(time: np.ndarray) -> np.ndarray:
    """Return roll, pitch and heading, degrees: a drone that swings while it turns."""
    return np.column_stack([
        4.0 * np.sin(2.1 * time), -3.0 + 5.0 * np.cos(1.7 * time), 250.0 + 9.0 * time + 6.0 * np.sin(1.3 * time),
    ])  # fmt: skip


def attitude(time: np.ndarray) -> Rotation:
    """Return the body's rotation to north, east, down."""
    return Rotation.from_euler("ZYX", angles(time)[:, ::-1], degrees=True)


def along(time: np.ndarray) -> np.ndarray:
    """Return the place (n, 3) east, north, up of the beginning, m."""
    return np.column_stack([8.0 * time + np.sin(time), -3.0 * time, 120.0 + 2.0 * np.cos(0.8 * time)])


def truth(time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return velocities and angular rates (degrees a second) along and about east, north, up."""
    moment = 1e-4
    turn = (attitude(time + moment) * attitude(time - moment).inv()).as_rotvec(degrees=True) / (2.0 * moment)
    return (along(time + moment) - along(time - moment)) / (2.0 * moment), turn @ ENU.T


def sbet(rate: float, noise: float, random: np.random.Generator) -> bytes:
    """Return the flight as an SBET, whose wander angle is not zero, its attitude with errors (degrees)."""
    time = np.arange(0.0, 40.0, 1.0 / rate)
    place, wander = along(time), 0.3
    longitude, latitude, _ = Geod(ellps="WGS84").fwd(
        np.full(len(time), LONGITUDE), np.full(len(time), LATITUDE), np.degrees(np.arctan2(place[:, 0], place[:, 1])),
        np.hypot(place[:, 0], place[:, 1]),
    )  # fmt: skip
    east, north, up = truth(time)[0].T
    level = [np.cos(wander) * north - np.sin(wander) * east, -np.cos(wander) * east - np.sin(wander) * north, up]
    said = np.radians(angles(time) + random.normal(scale=noise, size=(len(time), 3)))
    said[:, 2] += wander
    columns = [time + 1000.0, np.radians(latitude), np.radians(longitude), place[:, 2], *level, *said.T]
    rest = np.zeros((len(time), 6))
    return np.column_stack([*columns, np.full(len(time), wander), rest]).astype("<f8").tobytes()


def imported(folder: Path, project: str, **settings: float) -> tuple[Station, ...]:
    random = np.random.default_rng(7)
    (folder / "flown.sbet").write_bytes(sbet(settings.get("rate", 200.0), settings.get("noise", 0.0), random))
    rows = "".join(f"P{row},{time + 1000.0:.6f}\n" for row, time in enumerate(EVENTS))
    (folder / "events.csv").write_text("photo,time\n" + rows)
    (folder / "orip.toml").write_text(project)
    said = orip(folder, "stations", "import", "flown.sbet", "--events", "events.csv")
    assert said.code == 0, said.err
    found = read_stations(folder / "F.STA", "S")
    assert found.complaints == ()
    return found.value


def in_grid(values: np.ndarray) -> np.ndarray:
    """Return vectors (n, 3) along east, north, up turned by the meridian convergence."""
    convergence = Proj("EPSG:25832").get_factors(LONGITUDE, LATITUDE).meridian_convergence
    return Rotation.from_euler("z", convergence, degrees=True).apply(values)


def test_motions_are_differences_of_the_flight_along_the_axes_of_the_project(tmp_path: Path) -> None:
    motions = [station.motion for station in imported(tmp_path, ROLLING)]
    velocity, rate = map(in_grid, truth(EVENTS))
    assert np.abs(rate).max(axis=0).min() > 5.0
    # means over 50 ms of swings of 2.1 rad/s, and a geodesic on the ellipsoid at 130 m
    np.testing.assert_allclose([motion.velocity for motion in motions], velocity, atol=0.005)
    np.testing.assert_allclose(np.degrees([motion.rate for motion in motions]), rate, atol=0.01)
    assert np.degrees(motions[0].rate_error).max() < 0.01


def test_errors_of_rates_are_those_of_the_attitudes(tmp_path: Path) -> None:
    motions = [station.motion for station in imported(tmp_path, ROLLING, noise=0.01)]
    off = np.degrees([motion.rate for motion in motions]) - in_grid(truth(EVENTS)[1])
    normed = off / np.degrees([motion.rate_error for motion in motions])
    # errors of attitudes that are independent: the root of 70 / 126, as long as the noise is more than the swings
    assert np.sqrt(np.mean(normed**2)) == pytest.approx(0.75, abs=0.12)


def test_without_a_rolling_shutter_lines_are_as_short_as_ever(tmp_path: Path) -> None:
    assert all(station.motion is None for station in imported(tmp_path, PROJECT))


def test_of_seldom_epochs_without_attitude_velocities_have_the_errors_of_what_is_between_them() -> None:
    """Swings of 3 s are between epochs of a second: by no more than the standard deviations say."""
    time = np.arange(0.0, 40.0)
    place = np.column_stack([5.0 * time + 0.5 * np.sin(2.1 * time), 0.0 * time, 0.0 * time])
    trajectory = epochs("t", np.arange(1, 41), time=time, place=place, is_geographic=False)
    found = motions_at(trajectory, EVENTS)
    off = found.values[:, 0] - (5.0 + 0.5 * 2.1 * np.cos(2.1 * EVENTS))
    assert np.sqrt(np.mean(off**2)) > 0.1
    inside = (EVENTS > 3.0) & (EVENTS < 36.0)
    assert np.sqrt(np.mean(off[inside] ** 2)) < 1.2 * found.errors[inside, 0].max()
    assert np.isnan(found.values[:, 3:]).all()


def test_the_smoother_of_inertial_data_gives_motions(tmp_path: Path) -> None:
    pytest.importorskip("gtsam")
    flown = flight(strips=2, straight=20.0, rate=100.0)
    written(tmp_path, flown, *observed(flown, TACTICAL, np.random.default_rng(4), deviation=(0.03, 0.03, 0.03)))
    times = np.arange(18.05, flown.time[-1] - 3.0, 1.5)
    rows = "".join(f"P{row},{time + START:.4f}\n" for row, time in enumerate(times))
    (tmp_path / "events.csv").write_text("photo,time\n" + rows)
    (tmp_path / "orip.toml").write_text(ROLLING)
    said = orip(tmp_path, "imu", "imu.csv.gz", "flight.pos", LEVER, "--noise", "tactical", "--events", "events.csv")
    assert said.code == 0, said.err
    motions = [station.motion for station in read_stations(tmp_path / "F.STA", "S").value]
    at = np.searchsorted(flown.time, times - 1e-6)
    turn = (
        Rotation.from_matrix(flown.rotation[at + 1]) * Rotation.from_matrix(flown.rotation[at - 1]).inv()
    ).as_rotvec()
    rate = np.degrees(turn) / (flown.time[at + 1] - flown.time[at - 1])[:, None]
    assert np.abs(rate[:, 2]).max() > 10.0
    # the map is turned by a degree: the flight stands 0.2 rad east of Greenwich
    convergence = Proj("EPSG:25832").get_factors(np.degrees(0.2), 50.0).meridian_convergence
    to_grid = Rotation.from_euler("z", convergence, degrees=True)
    np.testing.assert_allclose([motion.velocity for motion in motions], to_grid.apply(flown.velocity[at]), atol=0.05)
    np.testing.assert_allclose(np.degrees([motion.rate for motion in motions]), to_grid.apply(rate), atol=0.1)
