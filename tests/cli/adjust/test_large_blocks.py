"""What an adjustment of many observations writes in place of long texts, and how the texts are had on request."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from cli.command_line import orip
from workflow.small_projects import first_project

from orip.records.results import solution


@pytest.fixture
def project(tmp_path: Path) -> Path:
    folder = first_project(tmp_path / "first")
    assert orip(folder, "run").code == 0
    return folder


def test_residuals_are_arrays_and_the_table_is_written_on_request(
    project: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    table = (project / "residuals.csv").read_bytes()
    assert json.loads((project / "result.json").read_text())["residuals_file"] == "residuals.csv"
    monkeypatch.setattr(solution, "MOST_AS_TEXT", 10)
    said = orip(project, "solve")
    assert said.code == 0
    assert "residuals.npz" in said.out
    assert not (project / "residuals.csv").exists(), "it would be taken for that of this adjustment"
    assert json.loads((project / "result.json").read_text())["residuals_file"] == "residuals.npz"
    listing = (project / "BUNDLE_RESULT.OUT").read_text()
    assert "'orip results residuals' shows them" in listing
    assert "'orip results points' shows them" in listing
    points = json.loads((project / "result.json").read_text())["point_columns"]["name"]
    assert list(orip(project, "results", "points", "--json").document["points"]) == points
    assert orip(project, "results", "residuals", "--output", str(project / "again.csv")).code == 0
    assert (project / "again.csv").read_bytes() == table
    rows = [line.split(",") for line in table.decode().splitlines()[1:]]
    found = np.load(project / "residuals.npz")
    for place, (column, names) in enumerate([("kind", "kinds"), ("photo", "photos"), ("point", "points")]):
        assert found[names][found[column]].tolist() == [row[place] for row in rows]
    assert found["residual"].tolist() == [float(row[5]) for row in rows]
    w = [float(row[10] or "nan") for row in rows]
    # single precision: seven digits
    np.testing.assert_allclose(found["w"], w, rtol=1e-7)
    assert "up to date" in orip(project, "status").out


def test_a_file_of_residuals_in_another_format_is_refused(project: Path) -> None:
    said = orip(project, "results", "residuals", "--output", "residuals.txt")
    assert said.code == 2
    assert "residuals.csv" in said.err
    said = orip(project, "results", "residuals", "st1", "--output", "residuals.csv")
    assert said.code == 2
    assert "all residuals" in said.err
