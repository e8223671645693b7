"""Stations in other systems than the project's, and with the angles of navigation."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from pyproj import CRS, Proj, Transformer

from orip.errors import InputError
from orip.files.control.stations_text import parse_stations_and_reference
from orip.files.text.lines import decode_lines
from orip.geometry.other_crs import stations_of_reference
from orip.geometry.rotation import rotation_from_angles, rotation_from_navigation
from orip.records.control import Station

PLACE = (9.9351, 53.5522, 142.21)
LINE = "P1 {} {} {} 0.01 0.03 0.02 2 -3 135 0.1 0.2 0.3\n"


def converted(text: str, crs: str | None = "EPSG:25832") -> tuple[Station, ...]:
    parsed = parse_stations_and_reference(decode_lines(text.encode(), "Z"), "Z")
    assert not parsed.complaints
    return stations_of_reference(*parsed.value, crs, "m")


def in_grid() -> tuple[float, float, float]:
    east, north = Transformer.from_crs(4258, 25832, always_xy=True).transform(*PLACE[:2])
    return east, north, PLACE[2]


def test_geographic_and_geocentric_positions_are_the_same_place() -> None:
    (geographic,) = converted("CRS EPSG:4258\n" + LINE.format(*PLACE))
    assert geographic.position == pytest.approx(in_grid(), abs=1e-6)
    geocentric = Transformer.from_crs(CRS.from_epsg(4258).to_3d(), 4936, always_xy=True).transform(*PLACE)
    (found,) = converted("CRS EPSG:4936\n" + LINE.format(*map(repr, geocentric)))
    assert found.position == pytest.approx(in_grid(), abs=1e-6)
    # the sum of the variances does not depend on the axes
    assert np.trace(found.covariance) == pytest.approx(0.01**2 + 0.03**2 + 0.02**2)
    other = Transformer.from_crs(25832, 25833, always_xy=True).transform(*in_grid()[:2])
    (neighbour,) = converted("CRS EPSG:25833\n" + LINE.format(*map(repr, (*other, PLACE[2]))))
    assert neighbour.position == pytest.approx(in_grid(), abs=1e-6)


def test_errors_are_turned_by_the_convergence() -> None:
    (found,) = converted("CRS EPSG:4258\n" + LINE.format(*PLACE))
    angle = np.radians(Proj(CRS.from_epsg(25832)).get_factors(*PLACE[:2]).meridian_convergence)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    expected = turn @ np.diag([0.01, 0.03]) ** 2 @ turn.T
    np.testing.assert_allclose(np.array(found.covariance)[:2, :2], expected, rtol=1e-6)


def test_motions_are_turned_as_errors_are() -> None:
    motion = "- " * 17 + "10 0 1 0.3 0.1 0.2 0 5 2 0.1 0.1 0.1"
    (found,) = converted("CRS EPSG:4258\n" + LINE.format(*PLACE).rstrip() + " " + motion + "\n")
    angle = np.radians(Proj(CRS.from_epsg(25832)).get_factors(*PLACE[:2]).meridian_convergence)
    sine, cosine = np.sin(angle), np.cos(angle)
    assert found.motion is not None
    np.testing.assert_allclose(found.motion.velocity, [10 * cosine, 10 * sine, 1], atol=1e-7)
    np.testing.assert_allclose(np.degrees(found.motion.rate), [-5 * sine, 5 * cosine, 2], atol=1e-7)
    np.testing.assert_allclose(found.motion.velocity_error[0], np.hypot(0.3 * cosine, 0.1 * sine), rtol=1e-6)
    assert np.degrees(found.motion.rate_error) == pytest.approx([0.1, 0.1, 0.1])


def test_roll_pitch_heading_refer_to_true_north() -> None:
    (by_place,) = converted("CRS EPSG:4258\nANGLES ROLL PITCH HEADING\n" + LINE.format(*PLACE))
    (by_grid,) = converted("ANGLES roll pitch heading\n" + LINE.format(*in_grid()))
    convergence = np.radians(Proj(CRS.from_epsg(25832)).get_factors(*PLACE[:2]).meridian_convergence)
    turn = rotation_from_angles(np.array([0.0, 0.0, convergence]))
    expected = turn @ rotation_from_navigation(np.radians([[2.0, -3.0, 135.0]]))[0]
    for station in (by_place, by_grid):
        np.testing.assert_allclose(rotation_from_angles(np.array(station.angles)), expected, atol=1e-8)
        np.testing.assert_allclose(np.degrees(station.angle_error), [0.2, 0.2, 0.3])
    (plain,) = converted("ANGLES ROLL PITCH HEADING\n" + LINE.format(1, 2, 3), crs=None)
    # worked figures with four decimals
    np.testing.assert_allclose(np.degrees(plain.angles), [3.5355, 0.7052, -135.0741], atol=5e-5)


def test_constant_and_compared_stations_stay_what_they_are() -> None:
    text = "CRS EPSG:4258\nA {0} {1} {2} 0 0 0\nB {0} {1} {2} -1 -1 -1\n".format(*PLACE)
    constant, compared = converted(text)
    assert constant.position_error == (0.0, 0.0, 0.0)
    assert compared.position_error == pytest.approx((-1.0, -1.0, -1.0))


@pytest.mark.parametrize(
    ("crs", "project", "words"),
    [
        ("EPSG:99999", "EPSG:25832", "is not known to PROJ"),
        ("EPSG:5703", "EPSG:25832", "has no places on the earth; name a geographic or projected system"),
        ("EPSG:4258", None, "the project has no crs"),
        ("EPSG:4258+7837", "EPSG:25832", "cannot be taken to the ellipsoid"),
        (
            "EPSG:4326",
            "EPSG:31467",
            r"coordinates in WGS 84 cannot be taken to the datum of DHDN: .* Else give them in a system on",
        ),
    ],
)
def test_what_cannot_be_converted_is_refused(crs: str, project: str | None, words: str) -> None:
    with pytest.raises(InputError, match=words):
        converted(f"CRS {crs}\n" + LINE.format(*PLACE), project)


@pytest.mark.parametrize(
    ("text", "place", "words"),
    [
        ("CRS\n", "Z:1:5", "a field is missing"),
        ("CRS a\nCRS b\n", "Z:2:1", "a second CRS"),
        ("P1 1 2 3 1 1 1\nCRS EPSG:4258\n", "Z:2:1", "stands after a station"),
        ("ANGLES ROLL HEADING PITCH\n", "Z:1:1", "write ANGLES ROLL PITCH HEADING"),
    ],
)
def test_faulty_headings(tmp_path: Path, text: str, place: str, words: str) -> None:
    (said, *_) = map(str, parse_stations_and_reference(decode_lines(text.encode(), "Z"), "Z").complaints)
    assert said.startswith(f"{place}: ")
    assert words in said
