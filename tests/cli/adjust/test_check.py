"""`orip check`: gates against the last adjustment."""

from __future__ import annotations

from pathlib import Path

import pytest
from cli.command_line import orip
from workflow.small_projects import contents, first_project, replace_in, two_bundles

from orip.records.results.tests import GATE_FIGURES

pytestmark = pytest.mark.usefixtures("adjusted")


def gates_in_text(folder: Path, *gates: str) -> None:
    path = folder / "orip.toml"
    lines = "".join(f"  '{gate}',\n" for gate in gates)
    path.write_text(f"{path.read_text()}\n[check]\ngates = [\n{lines}]\n")


def test_gates_of_the_command_line(project: Path) -> None:
    before = contents(project)
    said = orip(project, "check", "sigma0<=1.5", "singular == 0", "redundancy>=1")
    assert said.code == 0
    lines = said.out.splitlines()
    assert lines[0].startswith("pass sigma0 <= 1.5 (0.")
    assert lines[1] == "pass singular == 0 (0)"
    assert len(lines) == 3
    assert said.err == ""
    assert contents(project) == before
    assert orip(project, "check", "sigma0<=1.5", "singular == 0", "redundancy>=1") == said


def test_one_gate_that_fails_is_5_and_all_are_told(project: Path) -> None:
    said = orip(project, "check", "sigma0<=0.001", "singular==0")
    assert said.code == 5
    assert said.out.splitlines()[0].startswith("FAIL sigma0 <= 0.001 (0.")
    assert said.out.splitlines()[1].startswith("pass ")
    assert said.out.splitlines()[2] == "check    1 of 2 gates failed"
    assert said.err == ""
    assert orip(project, "-q", "check", "sigma0<=0.001").err == ""


def test_json(project: Path) -> None:
    said = orip(project, "check", "singular<=0", "sigma0>100", "bogus==1", "check_points.max<1", "--json")
    assert said.code == 5
    document = said.document
    assert document["command"] == "check"
    assert (document["bundle"], document["status"], document["pass"]) == ("MAIN", "converged", False)
    first, second, third, fourth = document["gates"]
    assert first == {
        "name": "singular", "operator": "<=", "limit": 0.0, "value": 0.0, "pass": True, "reason": None
    }  # fmt: skip
    assert not second["pass"]
    assert (third["value"], third["pass"]) == (None, False)
    assert "there is no figure of this name" in third["reason"]
    assert (fourth["value"], fourth["reason"]) == (None, "the solution has no such figure")
    assert orip(project, "check", "singular<=0", "--json").document["pass"] is True


def test_gates_of_the_text_and_both(project: Path) -> None:
    gates_in_text(project, "sigma0<=1.5", "singular==0")
    said = orip(project, "check")
    assert said.code == 0
    assert [line.split()[1] for line in said.out.splitlines()] == ["sigma0", "singular"]
    said = orip(project, "check", "enp>4", "singular == 0")
    assert said.code == 0
    assert [line.split()[1] for line in said.out.splitlines()] == ["sigma0", "singular", "enp"]


def test_no_gate_at_all(project: Path) -> None:
    said = orip(project, "check")
    assert said.code == 2
    assert "there is no gate to check; give one, such as 'sigma0<=1.5', or write [check] gates in orip.toml" in said.err


def test_a_malformed_expression_is_wrong_usage(project: Path) -> None:
    said = orip(project, "check", "sigma0<1", "sigma0=1")
    assert said.code == 2
    assert "error: 'sigma0=1' is not a gate; write name operator number, for example 'sigma0<=1.5'" in said.err
    assert said.out == ""
    assert "error: 'rms' and 'enp<<3' are not gates; write name" in orip(project, "check", "rms", "enp>1", "enp<<3").err
    assert orip(project, "check", "sigma0", "--json").document["exit_code"] == 2


def test_malformed_gates_of_the_text_are_bad_input_with_their_lines(project: Path) -> None:
    gates_in_text(project, "sigma0", "singular==0", "enp > four")
    lines = (project / "orip.toml").read_text().splitlines()
    said = orip(project, "check", "enp>4", "--json")
    assert said.code == 3
    for wrong in ("sigma0", "enp > four"):
        line = lines.index(f"  '{wrong}',") + 1
        assert f"error: orip.toml:{line}: gates of [check]: '{wrong}' is not a gate; write name operator" in said.err
    assert len(said.document["errors"]) == 2


def test_nothing_adjusted_yet(tmp_path: Path) -> None:
    folder = first_project(tmp_path / "p")
    said = orip(folder, "check", "sigma0<1")
    assert said.code == 3
    assert "bundle MAIN has not been adjusted yet; run 'orip solve' first" in said.err


def test_an_adjustment_that_did_not_converge_is_4_whatever_the_gates(project: Path) -> None:
    replace_in(project / "orip.toml", 'name = "MAIN"', 'name = "MAIN"\nmax_iterations = 2\nstart_down_weight = 2')
    assert orip(project, "run").code == 4
    for gate in ("sigma0<1e9", "sigma0<0"):
        said = orip(project, "check", gate)
        assert said.code == 4
        assert gate.split("<")[1] in said.out.replace("1000000000", "1e9")
        assert "check    the last adjustment of MAIN did not converge" in said.out
    said = orip(project, "check", "sigma0<1e9", "--json")
    assert (said.code, said.document["status"], said.document["pass"]) == (4, "not_converged", False)


def test_an_adjustment_that_is_out_of_date_is_told(project: Path) -> None:
    replace_in(project / "FIRST.PNT", "1012.40", "1012.41")
    said = orip(project, "check", "sigma0<1.5")
    assert said.code == 0
    assert "warning: bundle MAIN: the last adjustment is out of date: changed since: FIRST.PNT" in said.err
    (warning,) = orip(project, "check", "sigma0<1.5", "--json").document["warnings"]
    assert warning["code"] == "out-of-date"


def test_several_bundles(tmp_path: Path) -> None:
    folder = two_bundles(tmp_path / "p")
    orip(folder, "run")
    assert orip(folder, "check", "sigma0<1.5").code == 2
    assert orip(folder, "check", "sigma0<1.5", "--bundle", "again").code == 0
    replace_in(folder / "SECOND.MEA", "1436.4", "1436.5")
    orip(folder, "measure")
    assert "out of date" in orip(folder, "check", "sigma0<1.5", "--bundle", "again").err
    assert "out of date" not in orip(folder, "check", "sigma0<1.5", "--bundle", "main").err


def test_the_help_lists_every_figure(project: Path) -> None:
    said = orip(project, "check", "--help")
    lines = [" ".join(line.split()) for line in said.out.splitlines()]
    for name, meaning in GATE_FIGURES.items():
        assert f"{name} {meaning}" in lines, "a line each"
