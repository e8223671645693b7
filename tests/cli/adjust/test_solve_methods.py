"""`orip solve --snoop`, `--prune`, `--variance-components`: what they leave in result.json, how they refuse."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from cli.command_line import orip
from workflow.small_projects import REPOSITORY, contents, first_project, many_bundles, replace_in


@pytest.fixture
def calibration(tmp_path: Path) -> Path:
    folder = tmp_path / "dcs260"
    folder.mkdir()
    for name in ("orip.toml", "DCS260.PNT", "DCS260.MEA"):
        shutil.copy(REPOSITORY / "sample_projects" / "dcs260_calibration" / name, folder)
    return folder


def test_a_blunder_is_named_with_its_size(calibration: Path) -> None:
    # point 14 of photo st1, 40 pixels (0.196 mm) too far right
    replace_in(calibration / "DCS260.MEA", "947.173913", "987.173913")
    assert orip(calibration, "run").code == 0
    said = orip(calibration, "solve", "--snoop", "--sigma0", "posteriori", "--json")
    assert said.code == 0
    first = said.document["blunders"][0]
    assert (first["order"], first["kind"], first["photo"], first["point"]) == (1, "photo", "st1", "14")
    assert first["component"] == "x"
    assert first["size"] == pytest.approx(40 * 7.5078 / 1536, abs=3 * first["sd"])
    assert first["statistic"] > first["limit"] > 3.0
    (advice,) = [diagnosis for diagnosis in said.document["diagnosis"] if diagnosis["where"] == "photo st1 point 14"]
    assert advice["code"] == "blunder"
    assert "measure it again" in advice["remedy"]
    rows = (calibration / "residuals.csv").read_text().splitlines()
    left_out = [row.split(",") for row in rows if row.startswith("photo,st1,14,")]
    assert [cells[8] for cells in left_out] == ["", ""], "left out: no weight factor, but a residual"
    assert abs(float(left_out[0][5])) > 0.1


def test_without_blunders_snooping_changes_nothing(tmp_path: Path) -> None:
    folder = first_project(tmp_path / "first")
    assert orip(folder, "run").code == 0
    plain = orip(folder, "solve", "--json").document
    snooped = orip(folder, "solve", "--snoop", "--json").document
    assert snooped["blunders"] == []
    assert snooped["down_weighted"] == plain["down_weighted"] == []
    # both ended at ENP 4: corrections of a ten-thousandth of a standard deviation
    for name, point in plain["points"].items():
        for axis in "XYZ":
            assert snooped["points"][name][axis]["value"] == pytest.approx(
                point[axis]["value"], abs=1e-4 * point[axis]["sd"]
            )
    assert snooped["run"] != plain["run"], "another method is another run"


def test_pruning_holds_a_useless_parameter_at_zero(calibration: Path) -> None:
    replace_in(calibration / "orip.toml", '"C", "DX", "DY"]', '"C", "DX", "DY", "A3", "B1"]')
    assert orip(calibration, "run").code == 0
    said = orip(calibration, "solve", "--prune", "--json")
    camera = said.document["cameras"]["DCS"]
    assert {kind for kind, parameter in camera.items() if parameter["sd"] is not None} == {"C", "DX", "DY"}
    assert camera["A3"] == {"value": 0.0, "sd": None}
    pruned = [diagnosis["text"] for diagnosis in said.document["diagnosis"] if diagnosis["code"] == "pruned"]
    assert len(pruned) == 2
    # what is left is the adjustment without the two
    replace_in(calibration / "orip.toml", '"C", "DX", "DY", "A3", "B1"]', '"C", "DX", "DY"]')
    plain = orip(calibration, "run", "--json").document
    assert said.document["sigma0"] == pytest.approx(plain["sigma0"], rel=1e-9)


def test_errors_of_the_groups_are_estimated(calibration: Path) -> None:
    # the photo points of this calibration are some 4 micrometres good
    replace_in(calibration / "orip.toml", "measurement_precision = 0.005", "measurement_precision = 0.002")
    assert orip(calibration, "run").code == 0
    said = orip(calibration, "solve", "--variance-components")
    assert said.code == 0, said.err
    assert "photo points of camera DCS" in said.out
    assert "1 by definition" in said.out
    document = orip(calibration, "solve", "--variance-components", "--json").document
    photo, *_ = document["variance_components"]
    assert (photo["kind"], photo["of"], photo["component"]) == ("photo", "DCS", "xy")
    assert document["sigma0"] == pytest.approx(1.0, abs=1e-2)
    # 0.8199 times 5 micrometres, as the adjustment with the error of 5 tells
    assert photo["factor"]["value"] * 2.0 == pytest.approx(0.8199 * 5.0, rel=0.01)
    listing = (calibration / "BUNDLE_RESULT.OUT").read_text()
    assert "VARIANCE COMPONENTS" in listing
    assert f"{photo['factor']['value']:.3f}" in listing
    assert "Estimated a-priori errors" in (calibration / "report.html").read_text()


@pytest.mark.parametrize("options", [("--sigma0", "posteriori"), ("--alpha", "0.01")])
def test_options_of_snooping_need_it(tmp_path: Path, options: tuple[str, str]) -> None:
    said = orip(first_project(tmp_path / "first"), "solve", *options)
    assert said.code == 2
    assert "need --snoop" in said.err


@pytest.mark.parametrize("alpha", ["0", "1", "-0.001", "small"])
def test_an_impossible_alpha_is_refused(tmp_path: Path, alpha: str) -> None:
    said = orip(first_project(tmp_path / "first"), "solve", "--snoop", "--alpha", alpha)
    assert said.code == 2
    assert "alpha" in said.err


def test_gates_of_the_command_line_and_of_the_project(tmp_path: Path) -> None:
    folder = first_project(tmp_path / "first")
    assert orip(folder, "run").code == 0
    passed = orip(folder, "solve", "--check", "sigma0<=1.5", "--check", "singular==0")
    assert passed.code == 0
    assert "pass sigma0 <= 1.5" in passed.out
    failed = orip(folder, "solve", "--check", "sigma0<=0.001")
    assert failed.code == 5
    assert "FAIL sigma0 <= 0.001" in failed.out
    with (folder / "orip.toml").open("a") as text:
        text.write('\n[check]\ngates = ["redundancy>=1000"]\n')
    said = orip(folder, "run")
    assert said.code == 5
    assert "FAIL redundancy >= 1000" in said.out
    assert (folder / "result.json").is_file(), "solved all the same"


def test_a_malformed_gate_is_refused_before_anything_is_done(tmp_path: Path) -> None:
    folder = first_project(tmp_path / "first")
    with (folder / "orip.toml").open("a") as text:
        text.write('\n[check]\ngates = ["sigma0 about 1"]\n')
    said = orip(folder, "run")
    assert said.code == 3
    assert "orip.toml:" in said.err
    assert not list(folder.glob("*.EXT"))


def test_run_takes_the_method_of_solve(calibration: Path) -> None:
    replace_in(calibration / "DCS260.MEA", "947.173913", "987.173913")
    said = orip(calibration, "run", "--snoop", "--check", "sigma0<=0.001", "--json")
    assert said.code == 5, "the gate of the command line fails"
    assert said.document["blunders"][0]["point"] == "14"
    solved = orip(calibration, "solve", "--snoop", "--json")
    assert solved.document["run"] == said.document["run"], "the same adjustment"
    refused = orip(calibration, "run", "--alpha", "0.01")
    assert refused.code == 2
    assert "--sigma0 and --alpha need --snoop" in refused.err


def test_run_adjusts_one_bundle_of_several(tmp_path: Path) -> None:
    folder = many_bundles(first_project(tmp_path / "first"), ["ONE", "TWO"])
    assert orip(folder, "run", "two").code == 0
    steps = {step["command"]: step["state"] for step in orip(folder, "status", "--json").document["steps"]}
    assert (steps["orip solve TWO"], steps["orip solve ONE"]) == ("up to date", "missing")
    before = contents(folder)
    refused = orip(folder, "run", "THREE")
    assert refused.code == 2
    assert "there is no bundle 'THREE'; the project's bundles are: ONE, TWO" in refused.err
    assert contents(folder) == before
