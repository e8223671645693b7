"""Control files: what is read, and what is said of faulty lines."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from orip.files.control.reader import read_control, read_control_file
from orip.files.control.text import (
    parse_directions,
    parse_distances,
    parse_elements,
    parse_figures,
    parse_points,
    points_text,
)
from orip.files.text.shown import Parsed

Parser = Callable[[Parsed[list[str]], str], Parsed[Any]]


def parse(parser: Parser, folder: Path, text: str) -> Parsed[Any]:
    (folder / "Z").write_text(text, encoding="utf-8", newline="")
    return read_control_file(parser, folder, "Z")


def complaints(parser: Parser, folder: Path, text: str) -> list[str]:
    return [str(complaint) for complaint in parse(parser, folder, text).complaints]


def test_points_with_all_forms_of_errors(tmp_path: Path) -> None:
    text = "! control\r\n1 1 2 3 0.1 0 -1\r\n2 1.5D1\t2 - 0.1 0.1 - # height unknown\r\n"
    text += "3 1 2 3 -1 -1 -1\n4 1 2 3 1 1 1 x\n"
    parsed = parse(parse_points, tmp_path, text)
    assert not parsed.complaints
    assert not parsed.warnings
    one, two, three, four = parsed.value
    assert (one.coordinates, one.errors, one.kind, one.line) == ((1, 2, 3), (0.1, 0, -1), "control", 2)
    assert (two.coordinates, two.errors) == ((15, 2, None), (0.1, 0.1, None))
    assert (three.kind, four.kind) == ("check", "rejected")


def test_the_malformed_control_file_of_a_real_case_is_refused_with_both_tokens(tmp_path: Path) -> None:
    text = "1 0 0 0 0 0 0\n2 -.062.821 .09373 0.0 0 0 0\n16 -.101.54 -.046598 0.0 0 0 0\n"
    assert complaints(parse_points, tmp_path, text) == [
        "Z:2:3: '-.062.821' is not a number; write a plain decimal such as -0.062821",
        "Z:3:4: '-.101.54' is not a number; write a plain decimal such as -0.10154",
    ]


def test_all_faults_of_a_file_come_at_once(tmp_path: Path) -> None:
    found = complaints(parse_points, tmp_path, "A 1,0 x 3 1 1 1\nB 1\nC 1 2 3 1 1 1\nC 1 2 3 1 1 inf\n")
    assert [complaint.split(" ")[0] for complaint in found] == ["Z:1:3:", "Z:1:7:", "Z:2:5:", "Z:4:13:", "Z:4:"]


def test_point_names_that_look_alike_are_a_warning(tmp_path: Path) -> None:
    parsed = parse(parse_points, tmp_path, "7 1 2 3 1 1 1\n007 1 2 3 1 1 1\na 1 2 3 1 1 1\nA 1 2 3 1 1 1\n")
    assert not parsed.complaints
    assert [str(warning).split(":")[1] for warning in parsed.warnings] == ["2", "4"]
    assert "'7' (line 1) and '007' (line 2)" in parsed.warnings[0].text
    assert parsed.warnings[0].code == "similar-names"


def test_elements_of_every_group(tmp_path: Path) -> None:
    text = "O camera c 8.6 0.01\nO CAMERA B2 0 0\nP1 PHOTO KAPPA 90 1\n7 POINT X 1 1\nS THEODOLITE R 12.5 -1\n"
    parsed = parse(parse_elements, tmp_path, text)
    assert not parsed.complaints
    assert [(e.name, e.group, e.kind, e.value, e.error) for e in parsed.value] == [
        ("O", "CAMERA", "C", 8.6, 0.01),
        ("O", "CAMERA", "B2", 0, 0),
        ("P1", "PHOTO", "KAPPA", 90, 1),
        ("7", "POINT", "X", 1, 1),
        ("S", "THEODOLITE", "R", 12.5, -1),
    ]


def test_points_of_elements_keep_their_case(tmp_path: Path) -> None:
    assert not complaints(parse_elements, tmp_path, "a POINT X 1 1\nA POINT X 1 1\n")


def test_distances(tmp_path: Path) -> None:
    parsed = parse(parse_distances, tmp_path, "D1 1 2 xyz 10.5 0.01\nD1 1 2 Z -3 0\nD2 2 3 XY 1 -1\n")
    assert not parsed.complaints
    assert [(d.start, d.end, d.code, d.distance, d.error) for d in parsed.value] == [
        ("1", "2", "XYZ", 10.5, 0.01),
        ("1", "2", "Z", -3, 0),
        ("2", "3", "XY", 1, -1),
    ]


def test_directions(tmp_path: Path) -> None:
    parsed = parse(parse_directions, tmp_path, "S1 A B 12.5 0.001\nS1 A C 13 0.001 91.5 0.002\n")
    assert not parsed.complaints
    assert [(d.target, d.direction, d.zenith, d.zenith_error) for d in parsed.value] == [
        ("B", 12.5, None, None),
        ("C", 13, 91.5, 0.002),
    ]


def test_absent_control_files_are_empty_and_faults_of_all_files_come_together(tmp_path: Path) -> None:
    assert read_control(tmp_path, "ZURICH").value.points == ()
    for extension in ("PNT", "ELE", "LEN", "DIR", "CON"):
        (tmp_path / f"ZURICH.{extension}").write_text("1\n")
    parsed = read_control(tmp_path, "ZURICH")
    assert [complaint.path for complaint in parsed.complaints] == [
        "ZURICH.PNT",
        "ZURICH.ELE",
        "ZURICH.LEN",
        "ZURICH.DIR",
        "ZURICH.CON",
    ]


def test_figures_name_their_points(tmp_path: Path) -> None:
    parsed = parse(parse_figures, tmp_path, "WALL plane 1 0.005\nWALL PLANE 2 -0.01   ! not used\nLAKE HEIGHT 1 2e-2\n")
    assert not parsed.complaints
    assert [(one.figure, one.kind, one.point, one.error, one.line) for one in parsed.value] == [
        ("WALL", "PLANE", "1", 0.005, 1),
        ("WALL", "PLANE", "2", -0.01, 2),
        ("LAKE", "HEIGHT", "1", 0.02, 3),
    ]


FAULTS: dict[Parser, list[tuple[str, str, str]]] = {
    parse_figures: [
        ("W PLAIN 1 0.01", "Z:1:3: ", "'PLAIN' is not a kind of figure; did you mean PLANE? Allowed: LINE, PLANE"),
        ("W PLANE 1", "Z:1:11: ", "a field is missing, 3 found; the line is: figure KIND point a"),
        ("W PLANE 1 0", "Z:1:11: ", "an a-priori error of 0 is not possible for a point of a figure"),
        ("D DIRECTION 1 0.01 2 0 0", "Z:1:26: ", "7 found; the line is: name DIRECTION from a to dX dY dZ"),
        ("D DIRECTION 1 0.01 1 0 0 1", "Z:1:20: ", "direction 'D' goes from '1' to itself; name two points"),
        ("D DIRECTION 1 0.01 2 0 0 0", "Z:1:22: ", "direction 'D' has no length"),
        ("D DIRECTION 1 0 2 0 0 1", "Z:1:15: ", "an a-priori error of 0 is not possible for a given direction"),
        ("W PLANE 1 0.01\nW LINE 2 0.01", "Z:2: ", "figure 'W' is a PLANE on line 1 and a LINE here"),
        ("W PLANE 1 0.01\nW PLANE 1 0.02", "Z:2: ", "point '1' of figure 'W' is already on line 1"),
    ],
    parse_points: [
        ("P 1,5 2 3 1 1 1", "Z:1:3: ", "decimal comma; write a decimal point: 1.5"),
        ("P 1 2 nan 1 1 1", "Z:1:7: ", "'nan' is not allowed"),
        ("P 1 2 3 1 1", "Z:1:13: ", "a field is missing, 6 found; the line is: name X Y Z aX aY aZ"),
        ("P,1,2,3,1,1,1", "Z:1:15: ", "1 found; separate fields by blanks or tabs, not by ','; the line is"),
        ("P;1 2 3 1 1 1", "Z:1:15: ", "6 found; separate fields by blanks or tabs, not by ';'; the line is"),
        ("% surveyed 1987", "Z:1:17: ", "a field is missing, 3 found; begin a remark with !; the line is: name X Y Z"),
        ("name X Y Z aX aY aZ", "Z:1: ", "this line has no numbers; begin a heading with !"),
        ("P 1e31 2 3 1 1 1", "Z:1:3: ", "'1e31' is too large for a number"),
        ("P 1 2 3 1 1 1 x y", "Z:1:19: ", "a field is missing"),
        ("P 1 2 3 1 1 1 y", "Z:1:15: ", "only x (rejected)"),
        ("P - 2 3 1 1 1", "Z:1:3: ", "the coordinate of X is '-' but its error is a number"),
        ("P 1 2 3 1 1 -", "Z:1:13: ", "the error of Z is '-' but its coordinate is a number"),
        ("P - - - - - -", "Z:1: ", "point 'P' has no coordinate at all"),
        ("- 1 2 3 1 1 1", "Z:1:1: ", "'-' is not allowed as a name"),
        ("P 1 2 3 1 1 1\n\nP 4 5 6 1 1 1", "Z:3: ", "point 'P' is already on line 1"),
        ("P 1 2 3 0.1 1e-300 0.1", "Z:1:13: ", "1e-300 is smaller than any that makes sense"),
        ("P 1 2 3 0.1 0.1 1e12", "Z:1:17: ", "or a negative one to disregard"),
    ],
    parse_elements: [
        ("O CAMRA C 1 1", "Z:1:3: ", "'CAMRA' is not an element group; did you mean CAMERA?"),
        ("O CAMERA R 1 1", "Z:1:10: ", "'R' is not a kind of CAMERA; write one of C, DX, DY, A1"),
        ("name GROUP KIND value a", "Z:1: ", "this line has no numbers"),
        ("O CAMERA C 1", "Z:1:14: ", "a field is missing"),
        ("O CAMERA C 1 1 1", "Z:1:16: ", "too many"),
        ("O CAMERA C 1 1\no CAMERA C 2 1", "Z:2: ", "C of CAMERA 'o' is already on line 1"),
        ("7 POINT X 1 1\n7 POINT X 1 1", "Z:2: ", "already on line 1"),
        ("O CAMERA C 8 1e5", "Z:1:14: ", "from 1e-06 to 1000 mm"),
        ("O PHOTO KAPPA 8 1e5", "Z:1:17: ", "360 degrees"),
    ],
    parse_distances: [
        ("D 1 1 X 1 1", "Z:1:5: ", "distance 'D' goes from '1' to itself"),
        ("D 1 2 XYZ 0 1", "Z:1:11: ", "write a length above 0"),
        ("D 1 2 YZ -4 1", "Z:1:10: ", "code YZ is -4"),
        ("D 1 2 XZ 4 1", "Z:1:7: ", "'XZ' is not a distance code; did you mean"),
        ("D 1 2 X 4", "Z:1:11: ", "the line is: name from to CODE distance a"),
        ("D 1 2 X 4 1\nD 1 2 X 5 1", "Z:2: ", "already on line 1"),
        ("D A B XYZ 5 1e-9", "Z:1:13: ", "or 0 for what is exactly known"),
    ],
    parse_directions: [
        ("S A B 1 1 90", "Z:1:14: ", "a field is missing, 6 found"),
        ("S A A 1 1", "Z:1:5: ", "points from 'A' to itself"),
        ("S A B 1 1\nS A B 2 1", "Z:2: ", "already on line 1"),
        ("S A B 1 1\nS C B 2 1", "Z:2: ", "set 'S' is at station 'A' on line 1 and at 'C' here"),
        ("S A B 5 1e-12", "Z:1:9: ", "degrees"),
    ],
}
"""Lines that are wrong, where they are complained of, and in which words."""


@pytest.mark.parametrize(
    ("parser", "text", "place", "words"), [(parser, *fault) for parser, faults in FAULTS.items() for fault in faults]
)
def test_faulty_lines(tmp_path: Path, parser: Parser, text: str, place: str, words: str) -> None:
    (complaint,) = complaints(parser, tmp_path, text)
    assert complaint.startswith(place)
    assert words in complaint


def test_names_with_blanks_are_one_complaint_and_not_two_for_each_line() -> None:
    lines = [f"GCP {number} 563204.977 5933405.006 28.320 0.01 0.01 0.015" for number in range(1, 10)]
    parsed = parse_points(Parsed(lines), "ELBE.PNT")
    (complaint,) = parsed.complaints
    assert "'GCP 1' seems to be one; write GCP_1 or GCP1" in str(complaint)
    # a single line with a field too many is no name with a blank
    (other,) = parse_points(Parsed(["1 1.0 2.0 3.0 0.01 0.01 0.01 0.02", "2 1.0 2.0 3.0 1 1 1"]), "ELBE.PNT").complaints
    assert "one field too many" in str(other)


def test_coefficients_of_correlation_may_follow_the_errors(tmp_path: Path) -> None:
    text = "1 1 2 3 0.1 0.2 0.3 0.5 -0.2 0.1\n2 1 2 3 0.1 0.2 0.3 - - -\n3 1 2 3 .1 .1 .1 .5 0 0 x\n"
    parsed = parse(parse_points, tmp_path, text)
    assert not parsed.complaints
    assert [point.correlations for point in parsed.value] == [(0.5, -0.2, 0.1), None, (0.5, 0.0, 0.0)]
    assert [point.kind for point in parsed.value] == ["control", "control", "rejected"]
    assert parse(parse_points, tmp_path, points_text(parsed.value)).value == parsed.value


def test_coordinates_before_coefficients_are_no_names_with_blanks(tmp_path: Path) -> None:
    lines = [f"CP{number} 1 2 3 .1 .2 .3 .5 -.2 .1\n" for number in range(1, 5)]
    parsed = parse(parse_points, tmp_path, "".join(lines))
    assert not parsed.complaints
    assert [point.name for point in parsed.value] == [f"CP{number}" for number in range(1, 5)]


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("1 1 2 3 .1 .1 .1 .9 .9 -.9", "that no three errors can have"),
        ("1 1 2 3 .1 .1 0 .1 .1 .1", "need errors of X, Y and Z that are not 0"),
        ("1 1 2 3 .1 .1 .1 .1 .1 .1 y", "one field too many"),
        ("1 1 2 3 .1 .1 .1 .1 .1", "9 found"),
    ],
)
def test_coefficients_that_are_impossible_are_refused(tmp_path: Path, line: str, words: str) -> None:
    (said,) = complaints(parse_points, tmp_path, line + "\n")
    assert words in said


NETWORK = "A 1 2 3 .02 .02 .03\nB 4 5 6 .02 .02 .03\nC 7 8 - .02 0 -\n"


def test_covariances_of_a_network_become_coefficients(tmp_path: Path) -> None:
    (tmp_path / "P.PNT").write_text(NETWORK, encoding="utf-8")
    text = "! network\nA B 2e-4 0 0  0 1e-4 0  0 0 4.5e-4\nA A 4e-4 1e-4 0 1e-4 4e-4 0 0 0 9e-4\n"
    (tmp_path / "P.COV").write_text(text, encoding="utf-8")
    found = read_control(tmp_path, "P")
    assert not found.complaints
    (pair,) = found.value.correlations
    assert (pair.first, pair.second) == ("A", "B")
    assert np.diag(pair.coefficients) == pytest.approx([0.5, 0.25, 0.5])
    assert found.value.points[0].correlations == pytest.approx((0.25, 0.0, 0.0))


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("A D 1e-4 0 0 0 0 0 0 0 0", "'D' is no control point"),
        ("A B 5e-4 0 0 0 0 0 0 0 0", "is not possible with a-priori errors of 0.02 and 0.02"),
        ("A C 0 1e-4 0 0 0 0 0 0 0", "an a-priori error of 0 in the .PNT file"),
        ("A C 0 0 1e-4 0 0 0 0 0 0", "no a-priori error in the .PNT file"),
        ("A A 9e-4 0 0 0 4e-4 0 0 0 9e-4", "is the root of the variance (0.03)"),
        ("A A 4e-4 1e-4 0 0 4e-4 0 0 0 9e-4", "are equal two by two"),
        ("A B 1e-4 0 0", "5 found"),
        ("A B 1e-4 0 0 0 0 0 0 0 0\nB A 0 0 0 0 0 0 0 0 0", "already on line 1"),
        ("A B 3.9e-4 3.9e-4 0 3.9e-4 -3.9e-4 0 0 0 0\nA A 4e-4 -3.9e-4 0 -3.9e-4 4e-4 0 0 0 9e-4", "not positive"),
    ],
)
def test_covariances_that_are_impossible_are_refused(tmp_path: Path, line: str, words: str) -> None:
    (tmp_path / "P.PNT").write_text(NETWORK, encoding="utf-8")
    (tmp_path / "P.COV").write_text(line + "\n", encoding="utf-8")
    (said,) = [str(complaint) for complaint in read_control(tmp_path, "P").complaints]
    assert said.startswith("P.COV:")
    assert words in said
