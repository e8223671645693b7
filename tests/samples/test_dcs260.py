"""The calibration of a Kodak DCS260 against J.-H. Yom's thesis (Glasgow, 2000) and an independent program."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from cli.command_line import orip
from support.sample_projects import sample
from workflow.quiet import run_quietly
from workflow.small_projects import contents, replace_in

from orip.records.camera import CAMERA_PARAMETERS
from orip.records.results.solution import Solution


@pytest.fixture
def project(tmp_path: Path) -> Path:
    return sample(tmp_path, "dcs260_calibration")


def solved(folder: Path) -> Solution:
    (outcome,) = run_quietly(folder)
    return outcome.solution


def parameter(solution: Solution, name: str) -> tuple[float, float]:
    """Return value and standard deviation of a parameter of the only camera."""
    column = CAMERA_PARAMETERS.index(name)
    return float(solution.cameras.values[0, column]), float(solution.cameras.sd[0, column])


def test_the_calibration(project: Path) -> None:
    # from the starting values of the thesis' file, up to 0.74 m off at a distance of 0.7 m
    solution = solved(project)
    assert solution.status == "converged"
    assert (solution.observations, solution.unknowns, solution.redundancy) == (250, 33, 217)
    # the independent program gives six decimals; 0.005 mm is the a-priori error
    assert solution.sigma0 * 0.005 == pytest.approx(0.004099, abs=2e-6)
    # ... and three decimals of the parameters and of their standard deviations
    for name, value, sd in (("C", 10.329, 0.093), ("DX", 0.101, 0.059), ("DY", 0.140, 0.061)):
        assert parameter(solution, name) == pytest.approx((value, sd), abs=6e-4), name


def test_with_the_misread_control_values(project: Path) -> None:
    replace_in(project / "DCS260.PNT", "-0.062821", "-0.062")
    replace_in(project / "DCS260.PNT", "-0.10154", "-0.101")
    eight = 'unknown = ["C", "DX", "DY", "A3", "P1", "P2", "B1", "B2"]\ndistortion_at = "measured"'
    replace_in(project / "orip.toml", 'unknown = ["C", "DX", "DY"]', eight)
    solution = solved(project)
    assert (solution.unknowns, solution.redundancy) == (38, 212)
    # the thesis prints 0.0042131 with other terms of the affinity; orip's own figure to its last digit
    residuals = np.asarray(solution.residuals.residual)
    assert np.sqrt(np.sum(residuals**2) / 250) == pytest.approx(0.004215, abs=1e-6)


@pytest.mark.parametrize("command", ["init", "run"])
def test_the_control_file_as_printed_is_refused(project: Path, command: str) -> None:
    replace_in(project / "DCS260.PNT", "-0.062821", "-.062.821")
    replace_in(project / "DCS260.PNT", "-0.10154", "-.101.54")
    before = contents(project)
    said = orip(project, command)
    assert said.code == 3
    lines = {line.split()[0]: number for number, line in enumerate(_lines(project), start=1) if line.split()}
    for point, token in (("2", "-.062.821"), ("16", "-.101.54")):
        line = lines[point]
        column = _lines(project)[line - 1].index(token) + 1
        assert f"error: DCS260.PNT:{line}:{column}: '{token}' is not a number" in said.err
    assert "2 errors; nothing was written" in said.err
    assert contents(project) == before, "no store was made"


def test_the_malformed_control_file_leaves_existing_stores_alone(project: Path) -> None:
    run_quietly(project)
    replace_in(project / "DCS260.PNT", "-0.10154", "-.101.54")
    before = contents(project)
    assert orip(project, "run").code == 3
    assert contents(project) == before


def _lines(project: Path) -> list[str]:
    return (project / "DCS260.PNT").read_text().splitlines()


def test_no_additional_parameter_is_significant_and_the_largest_w_is_named(project: Path) -> None:
    eight = 'unknown = ["C", "DX", "DY", "A3", "P1", "P2", "B1", "B2"]'
    replace_in(project / "orip.toml", 'unknown = ["C", "DX", "DY"]', eight)
    solution = solved(project)
    named = [
        diagnosis.text.split(" of camera ")[0]
        for diagnosis in solution.diagnosis
        if diagnosis.code == "not-significant"
    ]
    assert named == ["A3", "P1, P2", "B1", "B2"]
    row = int(np.nanargmax(solution.residuals.w))
    assert (solution.residuals.photo[row], solution.residuals.point[row]) == ("st5", "14")
    # an independent program prints one decimal
    assert solution.residuals.w[row] == pytest.approx(4.2, abs=0.05)
