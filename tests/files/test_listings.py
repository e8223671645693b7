"""Listings: every printed number is the solution's, nothing is cut, tables keep their columns."""

from __future__ import annotations

import itertools
import json
import math
import re

import numpy as np
import pytest
from hand_built_solutions import (
    INF,
    LONG_NAME,
    NAN,
    awkward,
    empty,
    error_listing,
    estimates,
    interior,
    listing,
    measured,
    residuals,
    result_listing,
    with_many_points,
)
from hypothesis import given
from hypothesis import strategies as st

from orip import __version__
from orip.bundle.results.reliability import reliability
from orip.files.identification import run_of_listing
from orip.files.listings import bundle_residuals as bundle_listing_residuals
from orip.files.listings.errors import interior_listing
from orip.files.result.json_text import result_text
from orip.records.camera import CAMERA_PARAMETERS
from orip.records.measurement import no_observations
from orip.records.results.solution import CheckPoint, Solution
from orip.structs import replace


def section(text: str, title: str) -> list[str]:
    """The lines of one section, from the line after its ruled title to the next title."""
    lines = text.split("\n")
    start = lines.index(title) + 2
    assert lines[start - 1] == "=" * len(title)
    following = (i for i in range(start, len(lines)) if re.fullmatch("=+", lines[i]))
    return lines[start : next(following, len(lines) + 1) - 1]


def cells(lines: list[str]) -> list[list[str]]:
    """The cells of the rows beneath the first rule, down to the first blank line."""
    rule = next(i for i, line in enumerate(lines) if re.fullmatch(r"[- ]+", line) and "-" in line)
    body = itertools.takewhile(bool, lines[rule + 1 :])
    return [re.split(" {2,}", line.strip()) for line in body]


def agrees(text: str, value: float) -> bool:
    """Whether a printed number is the value to its last printed digit, or the word for what is not a number."""
    if math.isnan(value):
        return text in ("-", "constant")
    if math.isinf(value):
        return text in ("singular", "inf", "-inf")
    mantissa, _, exponent = text.partition("e")
    decimals = len(mantissa.partition(".")[2]) - int(exponent or 0)
    return abs(float(text) - value) <= 0.5 * 10.0**-decimals * (1 + 1e-9)


def all_agree(texts: list[str], values: object) -> bool:
    numbers = np.asarray(values, dtype=np.float64).tolist()
    return len(texts) == len(numbers) and all(map(agrees, texts, numbers))


@pytest.mark.parametrize("solution", [awkward(), empty(), with_many_points(30)], ids=["awkward", "empty", "many"])
def test_listings_are_plain_text_and_always_the_same(solution: Solution) -> None:
    for text_of in (listing, error_listing):
        text = text_of(solution)
        assert text == text_of(solution)
        assert text.endswith("\n")
        assert "\f" not in text
        assert "nan" not in text
        assert all(line == line.rstrip() for line in text.split("\n"))


def test_usual_contents_fit_the_printer() -> None:
    text = listing(with_many_points(30))
    assert max(map(len, text.split("\n"))) <= 132


def test_the_title_block_names_program_project_user_bundle_run_and_status() -> None:
    for text_of in (listing, error_listing):
        head = text_of(awkward()).split("\n")[:8]
        assert head[0].endswith(f"orip {__version__}")
        assert "Project  ZURICH" in head
        assert "User     K. Dueholm" in head
        assert "Bundle   MAIN" in head
        assert "Status   doubtful" in head
        assert "Run id   20240229-0001-7f3a" in head


def test_a_status_that_is_not_converged_is_explained() -> None:
    assert "DOUBTFUL" in listing(awkward())
    assert "Do not use them" in error_listing(replace(awkward(), status="not_converged"))
    assert "STOPPED" in listing(empty())
    assert "DOUBTFUL" not in listing(replace(awkward(), status="converged"))


def test_the_run_id_is_read_back() -> None:
    for text in (listing(awkward()), error_listing(awkward())):
        assert run_of_listing(text) == awkward().run
        assert run_of_listing(text[:600]) == awkward().run
        assert run_of_listing(text.replace("\n", "\r\n")) == awkward().run
    assert run_of_listing(interior_listing(interior(), "ZURICH", "K. Dueholm", "r 17")) == "r 17"


def test_a_project_name_cannot_pose_as_a_run_id() -> None:
    solution = replace(awkward(), project="A\nRun id   false")
    assert run_of_listing(listing(solution)) == awkward().run


@given(st.text())
def test_any_text_is_searched_for_a_run_id(text: str) -> None:
    assert run_of_listing(text) is None


def test_key_figures() -> None:
    body = section(listing(awkward()), "KEY FIGURES")
    figures = dict(re.split(" {2,}", line.strip())[:2] for line in body if line)
    assert figures == {
        "Standard error of unit weight (sigma0)": "1.0342",
        "Standard error of unit weight (sigma0_all)": "1.8125",
        "Redundancy": "4",
        "Redundancy of the observations with weight factor 1": "3.14",
        "Observations (equations)": "15",
        "Unknowns": "12",
        "Exponent of numerical precision (ENP)": "5.12",
        "Down-weighted observations": "1",
        "Disregarded observations": "1",
        "Photo observations": "7",
        "Root mean square of the photo residuals": "0.04873",
        "A-priori error of an image coordinate": "0.00500",
        "Standard error of an image coordinate": "0.00517",
    }


def test_with_different_a_priori_errors_there_is_no_standard_error_of_an_image_coordinate() -> None:
    solution = awkward()
    solution.residuals.a_priori[0] = 0.004
    assert "of an image coordinate" not in listing(solution)


def test_no_redundancy_is_said() -> None:
    assert "no redundancy" in listing(empty())
    assert "no redundancy" not in listing(awkward())


def test_the_largest_standard_residuals_come_first_and_leave_out_the_disregarded() -> None:
    rows = cells(section(listing(awkward()), "LARGEST STANDARD RESIDUALS"))
    assert len(rows) == 10
    assert rows[0][:4] == ["photo", "P102", "7", "y"]
    assert rows[1][:4] == ["photo", "P102", "1001", "x"]
    sizes = [float(row[-4]) for row in rows]
    assert sizes == sorted(sizes, reverse=True)


def test_iterations() -> None:
    text = listing(awkward())
    rows = cells(section(text, "ITERATIONS"))
    assert rows == [
        ["1*", "-0.52", "210.2500", "0", "0"],
        ["2", "2.25", "3.1250", "3", "1"],
        ["3", "5.12", "1.0342", "1", "1"],
    ]
    assert "  * the step of this iteration was shortened or damped" in text


def test_cameras() -> None:
    solution = awkward()
    body = section(listing(solution), "CAMERAS")
    for i, name in enumerate(solution.cameras.names):
        rows = cells(["-", *body[body.index(f"  Camera {name}") + 4 :]])
        assert [row[0] for row in rows] == list(CAMERA_PARAMETERS[:-1])  # no camera has a readout
        assert all_agree([row[1] for row in rows], solution.cameras.values[i, :-1])
        assert all_agree([row[2] for row in rows], solution.cameras.sd[i, :-1])
    assert [row[3:] for row in rows[:5]] == [["mm"], ["mm"], ["mm"], [], ["mm^-2"]]


def test_the_projection_is_named_where_it_is_not_the_perspective() -> None:
    solution = replace(awkward(), projections=("perspective", "equidistant"))
    body = section(listing(solution), "CAMERAS")
    assert "  Camera OLYMPUS" in body
    assert "  Camera RESERVE, equidistant projection" in body
    assert json.loads(result_text(solution))["projections"] == {"OLYMPUS": "perspective", "RESERVE": "equidistant"}


def test_photos_with_standard_deviations_beneath_and_a_mark_near_phi_90() -> None:
    solution = awkward()
    body = section(listing(solution), "PHOTOS")
    rows = cells(body)
    assert [row[0] for row in rows] == ["P101", "sd", "P102", "sd*"]
    for i in range(2):
        assert all_agree(rows[2 * i][1:], solution.photos.values[i])
        assert all_agree(rows[2 * i + 1][1:], solution.photos.sd[i])
    assert any(line.startswith("  * PHI is so near to 90") for line in body)


def test_without_a_mark_there_is_no_footnote() -> None:
    solution = replace(awkward(), photo_rotation_sd_about_axes=(False, False))
    assert "so near to 90" not in listing(solution)


def test_points() -> None:
    for solution in (awkward(), with_many_points(120)):
        rows = cells(section(listing(solution), "POINTS"))
        assert [row[0] for row in rows] == list(solution.points.names)
        assert [row[1] for row in rows] == list(solution.point_kinds)
        assert [row[2] for row in rows] == [str(rays) for rays in solution.point_rays]
        for row, values, sd in zip(rows, solution.points.values, solution.points.sd, strict=True):
            assert all_agree(row[3:6], values)
            assert all_agree(row[6:], sd)


def test_the_smallest_standard_deviation_shows_two_digits() -> None:
    points = estimates(("1",), [[1000482.579395, 1.0, 2.0]], [[0.00041, 0.3, 0.2]], 3)
    solution = replace(awkward(), points=points, point_rays=np.array([2]), point_kinds=("tie",))
    (row,) = cells(section(listing(solution), "POINTS"))
    assert row[3] == "1000482.57940"
    assert row[6] == "0.00041"


def test_coordinates_of_constant_points_are_printed_in_full() -> None:
    points = estimates(("1",), [[1000482.579395, 1.0, 2.0]], [[NAN] * 3], 3)
    solution = replace(awkward(), points=points, point_rays=np.array([2]), point_kinds=("control",))
    (row,) = cells(section(listing(solution), "POINTS"))
    assert row[3:] == ["1000482.579395", "1.000000", "2.000000", "constant", "constant", "constant"]


def component_row_agrees(row: list[str], solution: Solution, i: int) -> bool:
    """Whether the numbers of a row ``... observed a v [unit] SR WF r w`` are those of component `i`."""
    found = solution.residuals
    size = row[-4:]
    measures = row[-8:-5] if len(row) > 8 else row[-7:-4]
    values = (found.observed[i], found.a_priori[i], found.residual[i])
    figures = (found.standard_residual[i], found.weight_factor[i], found.redundancy_number[i], found.w[i])
    return all_agree(measures, values) and all_agree(size, figures)


def test_control_and_other_ground_residuals() -> None:
    solution = awkward()
    text = listing(solution)
    control = cells(section(text, "CONTROL POINT RESIDUALS"))
    others = cells(section(text, "RESIDUALS OF ELEMENTS, DISTANCES AND DIRECTIONS"))
    assert [row[2] for row in control] == ["X", "Y", "Z"]
    assert [row[1] for row in others] == ["OLYMPUS", "OLYMPUS", "P101", "D1", "S1"]
    assert [row[-5] for row in others] == ["mm", "mm^-2", "degrees", "m", "degrees"]
    for i, row in enumerate([*control, *others], start=8):
        assert component_row_agrees(row, solution, i)


def test_without_control_the_section_says_none() -> None:
    solution = replace(awkward(), residuals=residuals(()), check_points=())
    text = listing(solution)
    assert section(text, "CONTROL POINT RESIDUALS")[0] == "  none"
    assert section(text, "CHECK POINTS: ADJUSTED MINUS GIVEN COORDINATES")[0] == "  none"
    assert section(text, "PHOTO RESIDUALS")[0] == "  none"


def test_check_points_with_the_root_mean_square_of_one_coordinate() -> None:
    points = (CheckPoint("K1", 0.012, -0.016, NAN), CheckPoint("K2", -0.03, 0.04, 0.1))
    body = section(listing(replace(awkward(), check_points=points)), "CHECK POINTS: ADJUSTED MINUS GIVEN COORDINATES")
    assert cells(body) == [["K1", "0.0120", "-0.0160", "-"], ["K2", "-0.0300", "0.0400", "0.1000"]]
    means = cells(body[6:])
    # sqrt((0.02² + 0.05²) / 4)
    assert means == [["XY", "0.0269", "0.0400", "4"], ["Z", "0.1000", "0.1000", "1"]]


def test_correlations() -> None:
    assert cells(section(listing(awkward()), "CORRELATIONS OF CAMERA UNKNOWNS")) == [
        ["OLYMPUS.C", "OLYMPUS.A3", "-0.973", "strong"],
        ["OLYMPUS.DX", "OLYMPUS.P2", "-"],
    ]


def photo_tables(solution: Solution) -> dict[str, list[list[str]]]:
    body = section(listing(solution), "PHOTO RESIDUALS")
    heads = [i for i, line in enumerate(body) if line.startswith("  Photo ")]
    return {body[i].split()[1].rstrip(":"): [" ".join(row).split() for row in cells(body[i:])] for i in heads}


@pytest.mark.parametrize("solution", [awkward(), with_many_points(25)], ids=["awkward", "many"])
def test_photo_residuals(solution: Solution) -> None:
    tables = photo_tables(solution)
    assert list(tables) == list(solution.photos.names)
    found, observed = solution.residuals, measured(solution)
    keys = zip(map(str.upper, observed.photos), observed.points, strict=True)
    on_template = dict(zip(keys, observed.measured.tolist(), strict=True))
    index = {key: i for i, key in enumerate(zip(found.kind, found.photo, found.point, found.component, strict=True))}
    columns = (
        found.a_priori,
        found.residual,
        reliability(found, 1.0).adjusted_sd,
        found.weight_factor,
        found.standard_residual,
        found.redundancy_number,
        found.w,
    )
    for photo, rows in tables.items():
        for row in rows:
            x, y = (index.pop(("photo", photo, row[0], axis)) for axis in "xy")
            assert all_agree(row[1:3], on_template[photo, row[0]])
            assert all_agree(row[3:], [column[i] for column in columns for i in (x, y)])
    assert "photo" not in {key[0] for key in index}


def test_a_component_that_is_missing_is_a_dash_and_a_repeated_point_has_its_own_row() -> None:
    numbers = [1.0, 0.001, 0.005, 0.2, 1.0, 0.5, 0.3]
    rows = tuple(("photo", "P101", "1", axis, *numbers) for axis in ("x", "y", "x"))
    first, second = photo_tables(replace(awkward(), residuals=residuals(rows)))["P101"]
    assert "-" not in first
    assert second[4::2] == ["-"] * 7


def test_without_the_observations_that_were_adjusted_there_are_no_measured_coordinates() -> None:
    solution = with_many_points(5)
    text = result_listing(solution, no_observations(solution.bundle))
    rows = cells(section(text, "PHOTO RESIDUALS")[4:])
    assert [" ".join(row).split()[1:3] for row in rows] == [["-", "-"]] * 5


def test_root_mean_squares_of_a_photo_leave_out_the_disregarded() -> None:
    text = listing(awkward())
    assert "  Photo P101:  2 points,  RMS of X_residual 0.00266 and Y_residual 0.00092 mm" in text
    assert "  Photo P102:  2 points,  RMS of X_residual 0.03110 and Y_residual 0.08844 mm" in text


def test_nothing_is_cut() -> None:
    name = "N" * 300
    solution = replace(
        awkward(),
        photos=replace(awkward().photos, names=(name, "P102")),
        project=name,
        check_points=(CheckPoint(name, *[1.0] * 3),),
    )
    text = listing(solution)
    assert text.count(name) == 3
    assert text.count(LONG_NAME) == 3
    assert "1000482.5794" in text


def test_numbers_of_a_diverged_adjustment_are_printed_whatever_they_are() -> None:
    photos = estimates(("P101", "P102"), [[1e200, NAN, -INF, 1e13, 5.0, 6.0]] * 2, [[INF] * 6] * 2, 6)
    rows = (("photo", "P101", "1", "x", 1.0, 1e200, 0.005, 2e202, 1e-30, 0.5, INF),)
    text = listing(replace(awkward(), photos=photos, residuals=residuals(rows)))
    assert "1.000000e+200" in text
    assert all_agree(cells(section(text, "PHOTOS"))[0][1:], photos.values[0])


def test_the_error_listing_names_what_is_wrong_and_what_to_do() -> None:
    text = error_listing(awkward())
    assert cells(section(text, "SINGULAR UNKNOWNS, REMOVED FROM THE ADJUSTMENT")) == [
        ["POINT", LONG_NAME, "Z", "13.4"],
        ["CAMERA", "OLYMPUS", "P1", "inf"],
    ]
    assert section(text, "DIAGNOSIS")[:2] == [
        f"  [one-ray-point] {LONG_NAME}: the point is seen in one photo only",
        "    What to do: Measure it in a second photo.",
    ]
    blunders = section(text, "BLUNDERS, IN THE ORDER THEY WERE FOUND")
    assert "  No. 1 cannot be told apart from distance D1: one of them is wrong" in blunders
    assert cells(blunders)[:2] == [
        ["1", "photo", "P102", "7", "y", "-0.13910", "0.00550", "mm", "26.35", "3.29"],
        ["2", "control", "1001", "Z", "0.1100", "0.0894", "m", "1.20", "-"],
    ]
    (row,) = cells(section(text, "DOWN-WEIGHTED OBSERVATIONS"))
    assert row[:4] == ["photo", "P102", "1001", "x"]
    assert component_row_agrees(row, awkward(), 2)
    assert section(text, "WARNINGS")[:2] == [
        "  [unused-control] ZURICH.PNT:12: no photo shows point 9004",
        '  [look-alike-names] points "7" and "07" — are they the same?',
    ]


def test_an_error_listing_without_errors_says_none() -> None:
    text = error_listing(empty())
    assert text.count("\n  none\n") == 6


def test_the_interior_listing_has_templates_first_and_every_mark() -> None:
    photo, template = interior()
    text = interior_listing([photo, template], "ZURICH", "K. Dueholm", "r1")
    assert [row[:2] for row in cells(section(text, "OVERVIEW"))] == [["Template", "STRIP_1"], ["Photo", "P101"]]
    for title, one in (("TEMPLATE ORIENTATIONS", template), ("PHOTO ORIENTATIONS", photo)):
        rows = cells(section(text, title))
        assert [row[0] for row in rows] == list(one.marks.names)
        for i, row in enumerate(rows):
            assert all_agree(row[1:7], [*one.given[i], *one.marks.measured[i], *one.residuals[i]])
            assert row[7:] == (["disregarded"] if one.marks.disregarded[i] else [])


def test_the_interior_listing_has_the_parameters_and_remarks() -> None:
    photo, template = interior()
    text = interior_listing([photo, template], "ZURICH", "K. Dueholm", "r1")
    body = section(text, "PHOTO ORIENTATIONS")
    assert "  Photo P101:  template to photo system, transformation affine" in body
    assert cells(body[12:]) == [
        ["0.0121", "-0.0341", "0.500000", "0.001000", "1.00020000", "0.99980000", "0.00312", "2"]
    ]
    body = section(text, "TEMPLATE ORIENTATIONS")
    assert "  Template STRIP_1:  plate to template system, transformation conformal without scale, UPPER stage" in body
    assert any("Mirror image" in line for line in body)
    assert any("Redundancy 0" in line for line in body)
    assert cells(body[9:])[0][6] == "-"


def test_an_interior_listing_without_orientations_says_none() -> None:
    assert interior_listing([], "ZURICH", "K. Dueholm", "r1").count("\n  none\n") == 3


@given(st.lists(st.tuples(st.sampled_from("PQ"), st.sampled_from("abc")), max_size=12))
def test_pairs_that_stand_together_are_those_found_one_by_one(measured: list[tuple[str, str]]) -> None:
    rows = [(photo, point, axis) for photo, point in measured for axis in "xy"]

    def pairs(of: list[tuple[str, str, str]]) -> list[list[int]]:
        names = [np.array([row[k] for row in of], dtype=object) for k in range(3)]
        return bundle_listing_residuals._pairs(*names).tolist()

    alone = [*rows, ("R", "d", "y")]  # is looked at row by row
    assert pairs(alone) == [*pairs(rows), [-1, len(rows)]]
