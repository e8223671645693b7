"""Exposure stations: what is read, and what is said of faulty lines."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from orip.files.control.stations_text import read_stations, stations_text
from orip.files.text.shown import Parsed
from orip.records.control import NOT_GIVEN, Station, StationMotion

POSITION = "P1 10 20 30 0.02 -0.03 0"
UP_TO_MOTION = "P1 1 2 3 1 1 1 " + "- " * 23


def parse(folder: Path, text: str) -> Parsed[tuple[Station, ...]]:
    path = folder / "Z.STA"
    path.write_text(text, encoding="utf-8")
    return read_stations(path, "Z")


def test_what_is_not_known_may_be_left_out_from_the_end(tmp_path: Path) -> None:
    text = f"{POSITION}\nP2 10 20 30 1 2 3 90 -1.5 180 0.1 0.1 0.2 12.5 S1 0.5 0 -0.25 ! all\n"
    text += "P3 - - - - - - 1 2 3 0.1 0.1 0.1\nP4 1 2 3 1 1 1 - - - - - - - S2\n"
    parsed = parse(tmp_path, text)
    assert not parsed.complaints
    one, two, three, four = parsed.value
    assert (one.position, one.position_error, one.line) == ((10, 20, 30), (0.02, -0.03, 0), 1)
    assert one.has_position
    assert not one.has_angles
    assert math.isnan(one.time)
    assert (one.strip, one.covariance) == ("", None)
    np.testing.assert_allclose(two.angles, np.radians([90, -1.5, 180]), rtol=1e-15)
    np.testing.assert_allclose(two.angle_error, np.radians([0.1, 0.1, 0.2]), rtol=1e-15)
    assert (two.time, two.strip) == (12.5, "S1")
    np.testing.assert_allclose(two.covariance, [[1, 1, 0], [1, 4, -1.5], [0, -1.5, 9]])
    assert not three.has_position
    assert three.has_angles
    assert (four.strip, four.has_angles, math.isnan(four.time)) == ("S2", False, True)


def test_a_file_that_is_absent_has_no_stations(tmp_path: Path) -> None:
    assert read_stations(tmp_path / "NONE.STA", "N") == Parsed(())


@pytest.mark.parametrize(
    ("line", "place", "words"),
    [
        ("P1 10 20 30 1 1", "Z:1:17: ", "a field is missing, 6 found; the line is: photo X Y Z aX aY aZ, then OMEGA"),
        ("P1 1 2 3 1 1 1 5", "Z:1:18: ", "a field is missing, 8 found"),
        ("P1 1 2 3 1 1 1 " + "- " * 36, "Z:1:", "is one field too many"),
        ("photo X Y Z aX aY aZ", "Z:1: ", "this line has no numbers"),
        ("P1 1 2 - 1 1 1", "Z:1:8: ", "'-' for a part of the position; give X, Y and Z and their errors"),
        ("P1 1 2 3 1 - 1", "Z:1:12: ", "'-' for a part of the position"),
        ("P1 1 2 3 1 1 1 1 2 - 1 1 1", "Z:1:20: ", "'-' for a part of the attitude; give OMEGA, PHI and KAPPA"),
        ("P1 - - - - - -", "Z:1: ", "photo 'P1' has neither a position nor angles; remove the line"),
        ("P1 1,5 2 3 1 1 1", "Z:1:4: ", "decimal comma; write a decimal point: 1.5"),
        ("P1 1 2 3 1 1 1e9", "Z:1:14: ", "larger than any that makes sense"),
        ("P1 1 2 3 1 1 1 1 2 3 1 1 999", "Z:1:26: ", "larger than any that makes sense"),
        ("P1 1 2 3 1 1 1 - - - - - - noon", "Z:1:28: ", "'noon' is not a number"),
        ("P1 1 2 3 1 1 1 - - - - - - 1 S 0.9 0.9 -0.9", "Z:1:32: ", "that no three errors can have"),
        ("P1 1 2 3 1 1 0 - - - - - - 1 S 0.1 0.1 0.1", "Z:1:32: ", "need errors of X, Y and Z that are not 0"),
        (UP_TO_MOTION + "1 2 3 1 1 -1", "Z:1:72: ", "an error of a motion is 0 or above"),
        (UP_TO_MOTION + "1 2 - 1 1 1", "Z:1:66: ", "'-' for a part of the velocity; give VX, VY and VZ"),
        (UP_TO_MOTION + "- - - - - - 1 2 3 1 1 99999", "Z:1:84: ", "write one from 1e-06 to 10000 degrees a second"),
    ],
)
def test_faulty_lines(tmp_path: Path, line: str, place: str, words: str) -> None:
    parsed = parse(tmp_path, line)
    assert parsed.value == ()
    (complaint,) = map(str, parsed.complaints)
    assert complaint.startswith(place)
    assert words in complaint


def test_all_faults_are_said_at_once(tmp_path: Path) -> None:
    parsed = parse(tmp_path, f"{POSITION}\np1 1 2 3 1 1 1\nP2 a 2 3 b 1 1\n")
    assert [str(complaint).split(": ")[0] for complaint in parsed.complaints] == ["Z:2", "Z:3:4", "Z:3:10"]
    assert "photo 'p1' is already on line 1" in str(parsed.complaints[0])
    assert [station.photo for station in parsed.value] == ["P1"]


def test_position_and_angles_may_be_correlated(tmp_path: Path) -> None:
    random = np.random.default_rng(8)
    root = random.normal(size=(6, 6)) * np.repeat([0.02, 1e-4], 3)[:, None]
    covariance = root @ root.T
    error = np.sqrt(np.diag(covariance))
    written = Station(
        "P1", (1.0, 2.0, 3.0), tuple(error[:3]), (0.1, 0.2, 0.3), tuple(error[3:]), tuple(map(tuple, covariance))
    )
    parsed = parse(tmp_path, stations_text([written]))
    assert not parsed.complaints
    # errors are written with four and six decimals
    found = np.array(parsed.value[0].covariance) / np.outer(error, error)
    np.testing.assert_allclose(found, covariance / np.outer(error, error), atol=5e-3)


def test_motions_are_read_as_they_are_written(tmp_path: Path) -> None:
    rate, error = np.radians([[5.0, -0.25, 10.0], [0.1, 0.1, 0.2]]).tolist()
    both = StationMotion((8.0, -2.5, 0.125), (0.03, 0.03, 0.0), tuple(rate), tuple(error))
    alone = StationMotion(rate=both.rate, rate_error=both.rate_error)
    position, errors = (1.0, 2.0, 3.0), (0.5, 0.5, 0.5)
    diagonal = tuple(tuple(0.25 if row == column else 0.125 for column in range(3)) for row in range(3))
    given = [
        Station("P1", position, errors, covariance=diagonal, time=7.0, strip="S", motion=both),
        Station("P2", position, errors, motion=alone),
        Station("P3", NOT_GIVEN, NOT_GIVEN, motion=StationMotion(both.velocity, both.velocity_error)),
    ]
    parsed = parse(tmp_path, stations_text(given))
    assert not parsed.complaints
    for written, read in zip(given, parsed.value, strict=True):
        assert (read.covariance is None) == (written.covariance is None)
        for name in StationMotion.__struct_fields__:
            np.testing.assert_allclose(getattr(read.motion, name), getattr(written.motion, name), rtol=1e-12)
