"""Stations in the project's coordinates, compared with PROJ and with worked figures."""

from __future__ import annotations

import numpy as np
import pytest
from pyproj import CRS, Proj, Transformer
from scipy.spatial.transform import Rotation

from orip.errors import InputError
from orip.geometry.rotation import angles_from_rotation, rotation_from_navigation
from orip.stations.in_project import Exposures, stations_in_project

PLACES = np.array([[9.95, 53.55, 120.0], [10.15, 53.60, 180.0]])


def exposures(places: np.ndarray = PLACES, *, is_geographic: bool = True, **more: object) -> Exposures:
    count = len(places)
    known = {
        "covariance": np.full((count, 3, 3), np.nan),
        "rotation": np.full((count, 3, 3), np.nan),
        "angle_error": np.full((count, 3), np.nan),
    }
    factors = [np.pi / 180, np.pi / 180, 1.0] if is_geographic else 1.0
    values = {**known, **more}
    return Exposures(
        tuple(f"P{row}" for row in range(count)), places * factors, is_geographic, values["covariance"],
        values["rotation"], values["angle_error"], np.arange(count, dtype=float), (True, False, True)[:count],
        ("S1",) * count,
    )  # fmt: skip


@pytest.mark.parametrize(
    ("roll", "pitch", "heading", "expected"),
    [
        (0, 0, 90, (0, 0, -90)),
        (0, 10, 0, (10, 0, 0)),
        (10, 0, 0, (0, 10, 0)),
        (2, -3, 135, (3.5355, 0.7052, -135.0741)),
    ],
)
def test_roll_pitch_heading_of_a_camera_that_looks_down(
    roll: float, pitch: float, heading: float, expected: tuple[float, float, float]
) -> None:
    rotation = rotation_from_navigation(np.radians([[roll, pitch, heading]]))
    # worked figures with four decimals
    np.testing.assert_allclose(np.degrees(angles_from_rotation(rotation))[0], expected, atol=5e-5)


def test_a_gimbal_turned_down_is_a_camera_that_looks_down() -> None:
    down = rotation_from_navigation(np.radians([[0.0, -90.0, 40.0]]), "gimbal")
    np.testing.assert_allclose(down, rotation_from_navigation(np.radians([[0.0, 0.0, 40.0]])), atol=1e-15)
    ahead = rotation_from_navigation(np.radians([[0.0, 0.0, 90.0]]), "gimbal")[0]
    # looks east: the camera's back to the west, right is south, up is up
    np.testing.assert_allclose(ahead, [[0, 0, -1], [-1, 0, 0], [0, 1, 0]], atol=1e-15)


def test_roll_pitch_heading_against_scipy() -> None:
    angles = np.random.RandomState(2).uniform(-1.5, 1.5, size=(50, 3))
    ned = Rotation.from_euler("ZYX", angles[:, ::-1]).as_matrix()
    axes = np.array([[0, 1, 0], [1, 0, 0], [0, 0, -1]])
    np.testing.assert_allclose(rotation_from_navigation(angles), axes @ ned @ axes, atol=1e-14)


def test_places_and_north_are_those_of_the_map() -> None:
    rotation = rotation_from_navigation(np.radians([[2.0, -3.0, 135.0]] * 2))
    covariance = np.tile(np.diag([0.01, 0.02, 0.03]) ** 2, (2, 1, 1))
    stations, _ = stations_in_project(
        exposures(rotation=rotation, covariance=covariance), "EPSG:25832", "m", (1, 1, 1), 0.01
    )
    expected = Transformer.from_crs(CRS.from_epsg(4258), CRS.from_epsg(25832), always_xy=True)
    for station, (longitude, latitude, height) in zip(stations, PLACES, strict=True):
        east, north = expected.transform(longitude, latitude)
        assert station.position == pytest.approx((east, north, height), abs=1e-6)
        convergence = Proj(CRS.from_epsg(25832)).get_factors(longitude, latitude).meridian_convergence
        turned = Rotation.from_euler("z", convergence, degrees=True).as_matrix() @ rotation[0]
        # the register's convergence against that of differences over 100 m: 1e-7 degrees
        np.testing.assert_allclose(station.angles, angles_from_rotation(turned[None])[0], atol=1e-8)
        sine, cosine = np.sin(np.radians(convergence)), np.cos(np.radians(convergence))
        correlated = -sine * cosine * (0.02**2 - 0.01**2)
        assert station.covariance is not None
        assert station.covariance[0][1] == pytest.approx(correlated, rel=1e-6)
    assert stations[0].position_error[2] == pytest.approx(0.03)
    assert stations[1].position_error[2] == pytest.approx(-0.03)


def test_heights_of_the_project_need_their_grid() -> None:
    with pytest.raises(InputError, match="cannot be taken to the ellipsoid"):
        stations_in_project(exposures(), "EPSG:25832+7837", "m", (1, 1, 1), 0.01)


def test_a_project_without_crs_has_no_place_for_longitudes() -> None:
    with pytest.raises(InputError, match="positions are longitude and latitude, but the project has no crs"):
        stations_in_project(exposures(), None, "m", (1, 1, 1), 0.01)
    stations, _ = stations_in_project(
        exposures(np.array([[1.0, 2.0, 3.0]]), is_geographic=False), None, "m", (0.1, 0.2, 0.3), 0.01
    )
    assert stations[0].position == (1.0, 2.0, 3.0)
    assert stations[0].position_error == pytest.approx((0.1, 0.2, 0.3))
    assert stations[0].covariance is None
