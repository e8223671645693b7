"""A project of twelve bundles: seventeen stores, measured, adjusted, renamed and counted like those of one."""

from __future__ import annotations

from cli.command_line import orip
from workflow.small_projects import first_project, many_bundles

from orip.workflow.project.state import read_project

BUNDLES = [f"B{number:02d}" for number in range(12)]


def test_twelve_bundles(tmp_path):
    folder = many_bundles(first_project(tmp_path / "first"), BUNDLES)
    assert orip(folder, "init").code == 0
    said = orip(folder, "measure")
    assert said.code == 0, said.err
    assert orip(folder, "solve", "B11").code == 0
    status = orip(folder, "status", "--json").document
    assert status["counts"]["bundles"] == 12
    assert status["counts"]["photo_points" if "photo_points" in status["counts"] else "photo points"] == 120
    solved = [step["command"] for step in status["steps"] if step["state"] == "up to date"]
    assert solved == ["orip init", "orip measure", "orip solve B11"]
    assert orip(folder, "bundle", "copy", "B11", "B12").code == 0
    assert orip(folder, "measure").code == 0
    assert "13 bundles" in orip(folder, "status").out
    observations = read_project(folder, "observations").measured.observations
    assert [len(observations[name].points) for name in BUNDLES] == [10] * 12
    assert sorted(path.name for path in folder.glob("*.EXO")) == [f"B{number:02d}.EXO" for number in range(13)]
