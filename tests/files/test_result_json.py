"""result.json: the schema field by field, numbers exact, nothing that is not JSON."""

from __future__ import annotations

import json
from typing import Any

import pytest
from hand_built_solutions import INF, LONG_NAME, NAN, awkward, empty, with_many_points
from hypothesis import given
from hypothesis import strategies as st

from orip.files.identification import run_of_result
from orip.files.result import json_text as module
from orip.files.result.json_text import result_document, result_text
from orip.records.camera import CAMERA_PARAMETERS
from orip.records.photo import PHOTO_PARAMETERS
from orip.records.results import solution as records
from orip.records.results.solution import Correlation, InteriorSummary, Solution
from orip.records.results.tests import GroupTest
from orip.structs import replace

TOP = [
    *("schema", "run", "project", "user", "bundle", "status", "verdict", "ground_unit"),
    *("sigma0", "sigma0_all", "redundancy", "redundancy_used", "observations", "unknowns", "enp"),
    *(
        "iterations",
        "cameras",
        "projections",
        "photos",
        "points",
        "point_columns",
        "antennas",
        "stations",
        "rigs",
        "mountings",
        "exposures",
        "motions",
        "theodolites",
        "figures",
        "down_weighted",
        "singular",
        "correlations",
        "blunders",
    ),
    *("diagnosis", "check_points", "groups", "variance_components", "interior", "inputs"),
    *("residuals_file", "warnings"),
]


def parsed(solution: Solution) -> dict[str, Any]:
    """The document as a strict reader of JSON sees it."""

    def refuse(constant: str) -> None:
        pytest.fail(f"{constant} is not JSON")

    document = json.loads(result_text(solution), parse_constant=refuse)
    assert isinstance(document, dict)
    return document


def test_the_text_is_the_document() -> None:
    assert parsed(awkward()) == result_document(awkward())
    assert parsed(empty()) == result_document(empty())


def test_names_and_order_of_the_schema() -> None:
    for solution in (awkward(), empty()):
        assert list(parsed(solution)) == TOP


def test_key_figures() -> None:
    document = parsed(awkward())
    expected = {
        "schema": "orip.result/2",
        "run": "20240229-0001-7f3a",
        "project": "ZURICH",
        "bundle": "MAIN",
        "status": "doubtful",
        "ground_unit": "m",
        "sigma0": 1.0342,
        "sigma0_all": 1.8125,
        "redundancy": 4,
        "redundancy_used": 3.1375,
        "observations": 15,
        "unknowns": 12,
        "enp": 5.1238,
    }
    assert {key: document[key] for key in expected} == expected


def test_iterations() -> None:
    assert parsed(awkward())["iterations"][1] == {
        "iteration": 2,
        "enp": 2.25,
        "sigma0": 3.125,
        "down_weighted": 3,
        "singular": 1,
    }


def test_cameras_list_every_parameter_with_null_for_a_constant_and_singular_for_a_removed_one() -> None:
    cameras = parsed(awkward())["cameras"]
    assert list(cameras) == ["OLYMPUS", "RESERVE"]
    assert list(cameras["OLYMPUS"]) == list(CAMERA_PARAMETERS)
    assert cameras["OLYMPUS"]["C"] == {"value": 8.595123, "sd": 0.0012}
    assert cameras["OLYMPUS"]["A1"] == {"value": 0.0, "sd": None}
    assert cameras["OLYMPUS"]["P1"] == {"value": 2.5e-5, "sd": "singular"}


def test_photos_are_in_degrees_as_the_solution_has_them() -> None:
    photos = parsed(awkward())["photos"]
    assert list(photos["P102"]) == list(PHOTO_PARAMETERS)
    assert photos["P101"]["KAPPA"] == {"value": 179.99875, "sd": 0.00012}
    assert photos["P102"]["Y0"]["sd"] == "singular"


def test_points() -> None:
    points = parsed(awkward())["points"]
    assert points[LONG_NAME] == {
        "X": {"value": 1000500.0, "sd": 0.031},
        "Y": {"value": 245000.125, "sd": 0.029},
        "Z": {"value": 410.5, "sd": "singular"},
        "rays": 1,
        "kind": "tie",
    }
    assert [point["kind"] for point in points.values()] == ["control", "tie", "rejected"]


def test_down_weighted_are_the_residuals_with_a_weight_factor_below_1() -> None:
    assert parsed(awkward())["down_weighted"] == [
        {
            "kind": "photo",
            "photo": "P102",
            "point": "1001",
            "component": "x",
            "residual": -0.0311,
            "standard_residual": 6.22,
            "weight_factor": 0.288,
        }
    ]


def test_what_is_wrong_with_the_block() -> None:
    document = parsed(awkward())
    assert document["singular"] == [
        {"group": "POINT", "name": LONG_NAME, "kind": "Z", "lost_digits": 13.42},
        {"group": "CAMERA", "name": "OLYMPUS", "kind": "P1", "lost_digits": None},
    ]
    assert document["correlations"] == [
        {"a": "OLYMPUS.C", "b": "OLYMPUS.A3", "r": -0.9731},
        {"a": "OLYMPUS.DX", "b": "OLYMPUS.P2", "r": None},
    ]
    assert document["blunders"][0] == {
        "order": 1,
        "kind": "photo",
        "photo": "P102",
        "point": "7",
        "component": "y",
        "size": -0.1391,
        "sd": 0.0055,
        "statistic": 26.35,
        "limit": 3.29,
        "alternatives": ["distance D1"],
    }
    assert document["diagnosis"] == [
        {
            "code": "one-ray-point",
            "where": LONG_NAME,
            "text": "the point is seen in one photo only",
            "remedy": "Measure it in a second photo.",
        }
    ]
    assert document["warnings"][0] == {
        "code": "unused-control",
        "where": "ZURICH.PNT:12",
        "text": "no photo shows point 9004",
    }


def test_groups_and_the_verdict() -> None:
    group = GroupTest(
        "element", "PHOTO", "Z0", 60, 2, 11.5, 3.25, 0.0, -0.125, 0.0625, 1e-5, 0.25, 0.02, "", NAN, NAN, doubted=True
    )
    document = parsed(replace(awkward(), verdict="Converged, but ...", groups=(group,)))
    assert document["verdict"] == "Converged, but ..."
    assert document["groups"] == [
        {
            "kind": "element",
            "of": "PHOTO",
            "component": "Z0",
            "number": 60,
            "down_weighted": 2,
            "redundancy": 11.5,
            "sigma0": 3.25,
            "p_sigma0": 0.0,
            "mean": {"value": -0.125, "sd": 0.0625},
            "p_mean": 1e-5,
            "shift": {"value": 0.25, "sd": 0.02},
            "worst": "",
            "worst_size": None,
            "p_worst": None,
            "doubted": True,
        }
    ]


def test_check_points_interior_and_inputs() -> None:
    document = parsed(awkward())
    assert document["check_points"] == [
        {"name": "K1", "dX": 0.012, "dY": -0.016, "dZ": None},
        {"name": "K2", "dX": -0.03, "dY": 0.04, "dZ": 0.1},
    ]
    assert list(document["interior"]) == ["templates", "photos"]
    assert document["interior"]["photos"] == {
        "P101": {
            "type": "A",
            "x0": 0.012,
            "y0": -0.034,
            "ro": 0.5,
            "sk": 0.001,
            "sx": 1.0002,
            "sy": 0.9998,
            "s0": 0.0031,
            "redundancy": 2,
        }
    }
    assert document["interior"]["templates"]["T1"]["s0"] is None
    assert document["inputs"] == {"orip.toml": "ab" * 32, "ZURICH.MEA": "cd" * 32}


def test_missing_numbers_are_null() -> None:
    document = parsed(empty())
    assert document["sigma0"] is None
    assert document["enp"] is None
    assert document["cameras"] == {}
    assert document["interior"] == {"templates": {}, "photos": {}}
    assert document["down_weighted"] == []


def test_equal_solutions_give_equal_texts() -> None:
    assert result_text(awkward()) == result_text(awkward())


def test_the_text_is_made_to_be_read_and_compared() -> None:
    text = result_text(with_many_points(50))
    lines = text.split("\n")
    assert lines[-1] == ""
    assert lines[-2] == "}"
    assert all(line == line.rstrip() for line in lines)
    assert sum('{"value": ' in line for line in lines) == text.count('"value"')
    assert max(map(len, lines)) < 200


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_floats_survive_exactly(r: float) -> None:
    (row,) = parsed(replace(empty(), correlations=(Correlation("a", "b", r),)))["correlations"]
    assert row["r"] == r


@given(st.sampled_from([NAN, INF, -INF]))
def test_no_number_that_is_not_finite_gets_out(value: float) -> None:
    summary = InteriorSummary("photos", "P", "A", value, value, value, value, value, value, value, 0)
    interior = parsed(replace(empty(), interior=(summary,)))["interior"]["photos"]["P"]
    assert interior["x0"] is None
    assert interior["s0"] is None


@given(st.text())
def test_the_run_id_is_read_back(run: str) -> None:
    assert run_of_result(result_text(replace(awkward(), run=run))) == run


def test_the_run_id_is_in_the_beginning_of_the_file() -> None:
    assert run_of_result(result_text(awkward())[:100]) == awkward().run


def test_the_run_id_is_found_in_a_reformatted_file() -> None:
    document = result_document(awkward())
    assert run_of_result(json.dumps(document, sort_keys=True)) == awkward().run
    assert run_of_result(json.dumps(document, indent=8)) == awkward().run


@pytest.mark.parametrize(
    "text",
    [
        "",
        "{",
        "null",
        "[]",
        "[" * 100_000,
        '{"schema": "orip.result/2"}',
        '{"schema": "orip.result/2", "run": 7}',
        '{"schema": "orip.result/2", "run": "cut',
        '{"schema": "other/1", "run": "r"}',
        '{"run": "r"}',
        '{"schema": "orip.result/2", "run": "\\q"}',
    ],
)
def test_garbage_has_no_run_id(text: str) -> None:
    assert run_of_result(text) is None


@given(st.text())
def test_any_text_is_tolerated(text: str) -> None:
    assert run_of_result(text) is None


@pytest.mark.parametrize("count", [1, 20_000], ids=["one", "several pieces"])
def test_points_are_written_as_every_other_part_is(count: int) -> None:
    solution = with_many_points(count, photos=2)
    points = solution.points
    points.values[0] = [1e-7, 1e22, NAN]
    points.sd[0] = [NAN, INF, 1e-5]
    names = ('a "quoted" %s', *points.names[1:])
    solution = replace(solution, points=replace(points, names=names))
    expected = "".join(module._json_pieces(result_document(solution), "")) + "\n"
    assert result_text(solution) == expected


def test_no_points_are_an_empty_object() -> None:
    assert "".join(module._json_pieces(result_document(empty()), "")) + "\n" == result_text(empty())


def large(solution: Solution, monkeypatch: pytest.MonkeyPatch) -> Solution:
    monkeypatch.setattr(records, "MOST_AS_TEXT", len(solution.residuals.kind) - 1)
    return solution


@pytest.mark.parametrize("count", [1, 3000], ids=["a line", "several lines"])
def test_points_of_a_large_block_are_columns(count: int, monkeypatch: pytest.MonkeyPatch) -> None:
    few = with_many_points(count)
    few.points.values[0] = [1e-7, 1e22, NAN]
    few.points.sd[0] = [NAN, INF, 1e-5]
    few = replace(few, points=replace(few.points, names=('a "quoted", Ü', *few.points.names[1:])))
    by_name = parsed(few)
    assert by_name["point_columns"] is None
    document = parsed(large(few, monkeypatch))
    assert document == result_document(few)
    assert list(document) == TOP
    assert document["points"] == {}
    columns = document["point_columns"]
    again = {
        name: {
            **{axis: {"value": columns[axis][row], "sd": columns[f"{axis}_sd"][row]} for axis in "XYZ"},
            "rays": columns["rays"][row],
            "kind": columns["kind"][row],
        }
        for row, name in enumerate(columns["name"])
    }
    assert again == by_name["points"]
    assert {key: document[key] for key in TOP if key not in ("points", "point_columns")} == {
        key: by_name[key] for key in TOP if key not in ("points", "point_columns")
    }


def test_columns_of_a_block_without_points(monkeypatch: pytest.MonkeyPatch) -> None:
    columns = parsed(large(empty(), monkeypatch))["point_columns"]
    assert len(columns) == 9
    assert set(map(len, columns.values())) == {0}
