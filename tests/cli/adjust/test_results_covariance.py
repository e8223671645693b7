"""`orip results covariance`: the covariance matrix of the last adjustment as a file."""

from __future__ import annotations

import csv
import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from cli.command_line import orip
from workflow.small_projects import first_project, replace_in


@pytest.fixture(scope="module")
def adjusted(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = first_project(tmp_path_factory.mktemp("covariance") / "first")
    assert orip(folder, "run", "--no-report", "--prune").code == 0
    return folder


@pytest.fixture
def project(adjusted: Path, tmp_path: Path) -> Path:
    return shutil.copytree(adjusted, tmp_path / "first")


def test_its_diagonal_has_the_squares_of_the_standard_deviations(project: Path, tmp_path: Path) -> None:
    file = tmp_path / "covariance.npz"
    assert orip(project, "results", "covariance", "--output", str(file)).code == 0
    result = json.loads((project / "result.json").read_text())
    with np.load(file) as found:
        names, matrix, values = found["names"].tolist(), found["covariance"], found["values"]
        assert str(found["run"]) == result["run"]
    np.testing.assert_allclose(matrix, matrix.T, rtol=1e-9, atol=1e-12 * np.abs(matrix).max())
    smallest, largest = np.linalg.eigvalsh(matrix / np.sqrt(np.outer(np.diag(matrix), np.diag(matrix))))[[0, -1]]
    assert smallest > -1e-9 * largest
    place = {name: row for row, name in enumerate(names)}
    for name, point in result["points"].items():
        for axis in "XYZ":
            if point[axis]["sd"] is None:
                assert f"point {name}.{axis}" not in place
                continue
            row = place[f"point {name}.{axis}"]
            assert values[row] == pytest.approx(point[axis]["value"], rel=1e-12)
            # the adjustment was computed again, with the same settings
            assert np.sqrt(matrix[row, row]) == pytest.approx(point[axis]["sd"], rel=1e-6)


def test_of_some_records_as_csv(project: Path, tmp_path: Path) -> None:
    whole, part = tmp_path / "whole.csv", tmp_path / "part.csv"
    result = json.loads((project / "result.json").read_text())
    photo = next(iter(result["photos"]))
    assert orip(project, "results", "covariance", "-o", str(whole)).code == 0
    assert orip(project, "results", "covariance", photo.lower(), "-o", str(part)).code == 0
    with whole.open(newline="") as file:
        header, *rows = csv.reader(file)
    wanted = {row[0]: dict(zip(header, row, strict=True)) for row in rows}
    with part.open(newline="") as file:
        own = list(csv.DictReader(file))
    assert {row["name"] for row in own} == {
        f"photo {photo}.{kind}" for kind in ("X0", "Y0", "Z0", "OMEGA", "PHI", "KAPPA")
    }
    for row in own:
        assert row["unit"] == ("m" if row["name"].endswith("0") else "degrees")
        for other in own:
            assert float(row[other["name"]]) == pytest.approx(float(wanted[row["name"]][other["name"]]), rel=1e-6)


def test_a_project_that_has_changed_is_adjusted_first(project: Path, tmp_path: Path) -> None:
    replace_in(project / "FIRST.PNT", "1012.40", "1012.41")
    said = orip(project, "results", "covariance", "-o", str(tmp_path / "covariance.npz"))
    assert said.code == 3
    assert "its project has changed since it was adjusted" in said.err
    assert not (tmp_path / "covariance.npz").exists()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["covariance"], "name the file of the covariance matrix: --output covariance.npz"),
        (["covariance", "-o", "matrix.txt"], "name the file of the covariance matrix"),
        (["covariance", "NOBODY", "-o", "a.npz"], "the solution has no camera, photo or point NOBODY"),
        (["points", "-o", "a.npz"], "--output is for 'orip results covariance'"),
    ],
)
def test_what_is_asked_for_wrongly_is_refused(project: Path, words: list[str], message: str) -> None:
    said = orip(project, "results", *words)
    assert said.code == 2
    assert message in said.err
