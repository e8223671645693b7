"""What is wrong with the Zurich City Hall data: six control points that are not the features measured.

An independent program finds, without them and with C, DX, DY unknown, a standard error of a photo coordinate of about
22 micrometres and check points at about 0.14 m (XY) and 0.11 m (Z); tolerances are half the last digit printed.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from support.sample_projects import sample
from workflow.quiet import run_quietly, solve_quietly
from workflow.small_projects import replace_in

from orip.bundle.methods import Method
from orip.bundle.snooping.search import SnoopingSettings
from orip.records.results.solution import Solution

SIX = {"201", "202", "211", "212", "311", "312"}
A_PRIORI_MM = 0.0064


@pytest.fixture
def project(tmp_path: Path) -> Path:
    return sample(tmp_path, "zurich_city_hall")


def change_control(folder: Path, change: dict[str, str], rest: str) -> None:
    """Write other a-priori errors behind the coordinates of constant control points."""
    path = folder / "ZURICH.PNT"
    pattern = re.compile(r"^(\s*(\S+)(?:\s+\S+){3})\s+0\s+0\s+0$", re.MULTILINE)
    text = pattern.sub(lambda found: f"{found[1]} {change.get(found[2], rest)}", path.read_text(encoding="utf-8"))
    path.write_text(text, encoding="utf-8")


def root_mean_squares(solution: Solution) -> tuple[float, float]:
    """Return those of the check points' differences, in plan and in height."""
    differences = np.array([(point.dX, point.dY, point.dZ) for point in solution.check_points])
    return float(np.sqrt(np.mean(differences[:, :2] ** 2))), float(np.sqrt(np.mean(differences[:, 2] ** 2)))


def test_control_that_is_not_what_was_measured_is_found_first(project: Path) -> None:
    change_control(project, {}, "0.02 0.02 0.02")
    run_quietly(project)
    solution = solve_quietly(project, method=Method(SnoopingSettings("posteriori"))).solution
    control = [blunder for blunder in solution.blunders if blunder.kind == "control"]
    first = [blunder.point for blunder in control if blunder.component == "X"][: len(SIX)]
    assert set(first) == SIX
    for blunder in control[: 3 * len(SIX)]:
        assert 0.0 < blunder.sd < 0.2
    # each of the six is off by more than a metre and a half, and that ten times more than its standard deviation
    for name in SIX:
        sizes = [(blunder.size, blunder.sd) for blunder in control if blunder.point == name]
        assert np.linalg.norm([size for size, _ in sizes]) > 1.5
        assert max(abs(size) / sd for size, sd in sizes) > 10.0


def test_without_the_six_the_block_is_four_times_better(project: Path) -> None:
    change_control(project, dict.fromkeys(SIX, "0 0 0 x"), "0 0 0")
    replace_in(project / "orip.toml", "c = 8.595", 'unknown = ["C", "DX", "DY"]\nc = 8.595')
    (outcome,) = run_quietly(project)
    assert outcome.solution.sigma0 * A_PRIORI_MM == pytest.approx(0.022, abs=0.0005)
    assert root_mean_squares(outcome.solution) == pytest.approx((0.14, 0.11), abs=0.005)
    kinds = dict(zip(outcome.solution.points.names, outcome.solution.point_kinds, strict=True))
    assert {name for name, kind in kinds.items() if kind == "rejected"} == SIX
