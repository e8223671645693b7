"""`orip compare`: two results against each other."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from cli.command_line import orip
from workflow.small_projects import contents, replace_in, two_bundles

pytestmark = pytest.mark.usefixtures("adjusted")


def changed(project: Path, change: Callable[[Any], object]) -> str:
    """Write other.json, the project's result after a change, and return its name."""
    document = json.loads((project / "result.json").read_text())
    change(document)
    (project / "other.json").write_text(json.dumps(document))
    return "other.json"


def one_point(**changed: object) -> dict[str, object]:
    """The columns of one point, some of them changed."""
    figures = {f"{axis}{what}": [1.0] for axis in "XYZ" for what in ("", "_sd")}
    return {"name": ["p"], **figures, "rays": [2], "kind": ["tie"], **changed}


def test_points_by_name_and_in_columns_and_results_of_earlier_versions(project: Path) -> None:
    def columns(document: Any) -> None:
        points = document.pop("points")
        found: dict[str, list[Any]] = {"name": list(points)}
        for axis in "XYZ":
            found[axis] = [point[axis]["value"] for point in points.values()]
            found[f"{axis}_sd"] = [point[axis]["sd"] for point in points.values()]
        for key in ("rays", "kind"):
            found[key] = [point[key] for point in points.values()]
        document.update(points={}, point_columns=found)

    def earlier(document: Any) -> None:
        del document["point_columns"]
        document["schema"] = "orip.result/1"

    assert orip(project, "compare", "result.json", changed(project, earlier)).code == 0
    assert orip(project, "compare", "result.json", changed(project, columns)).code == 0
    document = json.loads((project / "other.json").read_text())
    document["point_columns"]["Z"][0] += 1.0
    (project / "other.json").write_text(json.dumps(document))
    said = orip(project, "compare", "result.json", "other.json")
    assert said.code == 5
    assert said.out.splitlines()[2].startswith("point 1 Z")


def test_a_result_equals_itself_by_file_and_by_folder(project: Path, tmp_path: Path) -> None:
    before = contents(project)
    for a, b in (("result.json", "."), (".", str(project)), ("../first/result.json", "result.json")):
        said = orip(project, "compare", a, b)
        assert said.code == 0
        assert said.out == ""
        assert said.err.startswith("compare  equal: ")
    assert contents(project) == before
    (tmp_path / "empty").mkdir()
    assert orip(tmp_path / "empty", "compare", "../first", "../first", "--tolerance=0", "--relative=0").code == 0


def test_what_tells_how_the_adjustment_got_there_does_not_count(project: Path) -> None:
    def change(document: Any) -> None:
        document.update(run="another", project="B", bundle="B", enp=9.0, iterations=[], inputs={}, diagnosis=[])

    assert orip(project, "compare", "result.json", changed(project, change)).code == 0


def test_a_difference_is_5_and_told(project: Path) -> None:
    def change(document: Any) -> None:
        document["points"]["P1"]["Z"]["value"] += 0.01
        document["photos"]["left"]["KAPPA"]["value"] += 0.001
        document["sigma0"] += 1e-12

    said = orip(project, "compare", "result.json", changed(project, change))
    assert said.code == 5
    lines = said.out.splitlines()
    assert lines[0].split() == ["Figure", "A", "B", "Difference", "Allowed"]
    assert lines[2].startswith("point P1 Z")
    assert lines[3].startswith("photo left KAPPA")
    assert len(lines) == 4
    assert lines[2].split()[5] == "0.01"
    assert "compare  2 of " in said.err
    assert orip(project, "compare", "result.json", "other.json", "--tolerance", "0.011").code == 0
    assert orip(project, "compare", "result.json", "other.json", "--tolerance", "0.005").code == 5
    assert orip(project, "compare", "result.json", "other.json", "--sigma", "3").code == 0


def test_json(project: Path) -> None:
    def change(document: Any) -> None:
        document["points"]["P1"]["Z"]["value"] += 0.01
        document["status"] = "doubtful"
        document["points"]["new"] = document["points"]["P1"]
        del document["photos"]["right"]

    said = orip(project, "compare", "result.json", changed(project, change), "--json")
    assert said.code == 5
    document = said.document
    assert (document["command"], document["equal"]) == ("compare", False)
    assert (document["a"], document["b"]) == ("result.json", "other.json")
    status, height = document["differences"]
    assert status == {
        "name": "status",
        "a": "converged",
        "b": "doubtful",
        "difference": None,
        "allowed": status["allowed"],
    }
    assert height["name"] == "point P1 Z"
    assert height["difference"] == pytest.approx(0.01)
    assert document["only_in_a"] == ["photo right"]
    assert document["only_in_b"] == ["point new"]
    same = orip(project, "compare", "result.json", "result.json", "--json")
    assert same.code == 0
    assert same.document["equal"] is True


def test_at_most_twenty_are_listed_unless_verbose(project: Path) -> None:
    def change(document: Any) -> None:
        for point in document["points"].values():
            for axis in "XYZ":
                point[axis]["value"] += 1.0
                point[axis]["sd"] += 1.0

    said = orip(project, "compare", "result.json", changed(project, change))
    assert len(said.out.splitlines()) == 22
    assert "30 of " in said.err
    assert "at most 20 of each are listed; -v lists all" in said.err
    assert len(orip(project, "-v", "compare", "result.json", "other.json").out.splitlines()) == 32
    assert len(orip(project, "compare", "result.json", "other.json", "--json").document["differences"]) == 30


def test_case_counts_in_names_of_points_alone(project: Path) -> None:
    def change(document: Any) -> None:
        document["photos"]["LEFT"] = document["photos"].pop("left")
        document["points"]["p1"] = document["points"].pop("P1")

    said = orip(project, "compare", "result.json", changed(project, change))
    assert said.out.splitlines() == ["only in A: point P1", "only in B: point p1"]
    assert "1 are in result.json only; 1 are in other.json only" in said.err


def test_two_adjustments(project: Path) -> None:
    shutil.copy(project / "result.json", project.parent / "before.json")
    replace_in(project / "FIRST.PNT", "1012.40", "1012.42")
    orip(project, "run")
    assert orip(project, "compare", "../before.json", ".").code == 5
    assert orip(project, "compare", "../before.json", ".", "--sigma", "3").code == 0


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        (b"", "the file is empty"),
        (b"name,value\n", "error: other.json:1:1: this is not the result of an adjustment: this is not JSON; name a"),
        (b'{"schema":\n', "other.json:1:11: this is not the result of an adjustment: the file is cut off"),
        (b"{}\n{}", "other.json:2:1: this is not the result of an adjustment: something follows the end"),
        (b"[1, 2]", '"schema" is not "orip.result/2"'),
        (b'{"schema": "orip.error/1"}', '"schema" is not "orip.result/2"'),
        (b'{"schema": "orip.result/2"}', "'status' is not a text"),
        (b'{"schema": "orip.result/2", "x": NaN}', "JSON has no NaN"),
        (b"[" * 100000, "it is nested too deeply"),
        (b"\xff\xfe{}", "the file is UTF-16"),
        (b"{\xff}", "byte 0xFF is not UTF-8"),
    ],
)
def test_what_is_no_result_is_3(project: Path, text: bytes, sentence: str) -> None:
    (project / "other.json").write_bytes(text)
    for pair in (("result.json", "other.json"), ("other.json", "result.json"), ("other.json", "other.json")):
        said = orip(project, "compare", *pair)
        assert said.code == 3
        assert said.err.count("error: other.json") == 1
        assert said.out == ""
        assert sentence in said.err


@pytest.mark.parametrize(
    ("change", "where"),
    [
        (lambda document: document.update(points=3), "'points' is not an object"),
        (lambda document: document["points"].update(P1=[]), "'point P1' is not an object"),
        (lambda document: document["points"]["P1"].update(X=1.0), "'point P1 X' is not an object"),
        (lambda document: document["points"]["P1"]["X"].update(value="east"), "'point P1 X' is not a number or null"),
        (lambda document: document["points"]["P1"]["X"].update(sd=True), "'point P1 X' is not a number or null"),
        (lambda document: document["points"]["P1"]["X"].update(value=10**400), "'point P1 X' is not a number or null"),
        (lambda document: document.update(point_columns=3), "'point_columns' is not an object"),
        (lambda document: document.update(point_columns={}), "'point_columns name' is not a list with an element"),
        (lambda document: document.update(point_columns=one_point(Y=[])), "'point_columns Y' is not a list with an el"),
        (lambda document: document.update(point_columns=one_point(name=[7])), "'point_columns name' is not a list of"),
        (lambda document: document.update(point_columns=one_point(X=["1"])), "'point p X' is not a number or null"),
        (lambda document: document.update(check_points=[3]), "'check_points' is not an object"),
        (lambda document: document.update(singular=None), "'singular' is not a list"),
        (lambda document: document.update(status=1), "'status' is not a text"),
    ],
)
def test_a_result_with_a_fault_says_where(project: Path, change: Callable[[Any], object], where: str) -> None:
    said = orip(project, "compare", "result.json", changed(project, change))
    assert said.code == 3
    assert f"error: other.json: this is not the result of an adjustment: {where}" in said.err


def test_files_and_folders_that_are_not_there(project: Path, tmp_path: Path) -> None:
    said = orip(project, "compare", "nix.json", "nothing", "--json")
    assert said.code == 3
    assert [row["file"] for row in said.document["errors"]] == ["nix.json", "nothing"]
    assert said.err.splitlines()[-1] == "2 errors", "compare never writes, so it does not say that it has not"
    (tmp_path / "empty").mkdir()
    said = orip(project, "compare", "../empty", ".")
    assert said.code == 3
    assert "error: ../empty: there is no result.json in this folder; run 'orip solve' there first" in said.err


def test_a_folder_with_several_results(tmp_path: Path) -> None:
    folder = two_bundles(tmp_path / "p")
    orip(folder, "run")
    said = orip(folder, "compare", ".", ".")
    assert said.code == 2
    assert "the folder '.' has several results; name one of them: AGAIN_result.json, MAIN_result.json" in said.err
    assert orip(folder, "compare", "AGAIN_result.json", "AGAIN_result.json").code == 0
    assert orip(folder, "compare", "AGAIN_result.json", "MAIN_result.json").code == 5, "of another precision"


@pytest.mark.parametrize("option", ["--tolerance", "--relative", "--sigma"])
@pytest.mark.parametrize("value", ["-1", "nan", "inf"])
def test_tolerances_that_are_none(project: Path, option: str, value: str) -> None:
    said = orip(project, "compare", ".", ".", f"{option}={value}")
    assert said.code == 2
    assert f"Invalid value for '{option}': '{value}' is not a number of 0 or more" in said.err
    assert orip(project, "compare", ".", ".", option, "small").code == 2
    assert orip(project, "compare", ".").code == 2
