"""Iterations that creep along a valley end early, where what leads them is held at its start in the end."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from cli.command_line import orip

from orip.bundle import solve
from orip.bundle.problem import pose_problem
from orip.bundle.starting_state import starting_state
from orip.solving.starting_values import explained_preliminary_values, gather_bundle, started_block
from orip.workflow.adjust.gathering import block_input
from orip.workflow.adjust.solve import ADJUSTED_FROM
from orip.workflow.project.bundle_state import read_bundle

C, PIXEL = 27.0, 0.009


def level_block(folder: Path, relief: float) -> Path:
    """Write a free network of vertical photos over nearly level ground, started at the truth, whose C is unknown."""
    random = np.random.default_rng(20)
    points = np.column_stack([random.uniform(-60.0, 60.0, (60, 2)), relief * random.uniform(-1.0, 1.0, 60)])
    lines = [
        f'[project]\nname = "LEVEL"\n[[camera]]\nname = "CAM"\nc = {C}\nunknown = ["C"]',
        "sensor = { columns = 4000, rows = 3000, width = 36.0, height = 27.0 }",
    ]
    log = []
    for photo, x0 in enumerate(np.linspace(-30.0, 30.0, 6)):
        lines.append(f'[[photo]]\nname = "{photo}"\ncamera = "CAM"\nX0 = {x0}\nY0 = 0.0\nZ0 = 100.0')
        lines.append("OMEGA = 0.0\nPHI = 0.0\nKAPPA = 0.0")
        log.append(f"POINTS MAIN {photo}")
        for number, point in enumerate(points):
            scale = C / (100.0 - point[2]) / PIXEL
            column, row = 2000.0 + scale * (point[0] - x0), 1500.0 - scale * point[1]
            noise = random.normal(0.0, 1.0, 2)
            if 0.0 < column < 4000.0 and 0.0 < row < 3000.0:
                log.append(f"  {number} {column + noise[0]:.4f} {row + noise[1]:.4f}")
    lines.append('[[bundle]]\nname = "MAIN"\nmeasurement_precision = "1px"\ndatum = "free"')
    folder.mkdir()
    (folder / "orip.toml").write_text("\n".join([*lines, ""]))
    (folder / "LEVEL.MEA").write_text("\n".join([*log, ""]))
    rows = [f"{number} {x:.6f} {y:.6f} {z:.6f}" for number, (x, y, z) in enumerate(points)]
    (folder / "MAIN.PRE").write_text("\n".join([*rows, ""]))
    return folder


def test_vertical_photos_over_level_ground_settle_in_a_few_iterations(tmp_path: Path) -> None:
    """C went from 27 to 120 mm in eighty iterations before it was held."""
    folder = level_block(tmp_path / "level", 0.2)
    assert orip(folder, "run", "--no-report").code == 0
    result = json.loads((folder / "result.json").read_text(encoding="utf-8"))
    assert result["cameras"]["CAM"]["C"]["value"] == C
    assert len(result["iterations"]) <= 25
    # with C constant from the beginning it is the same
    text = (folder / "orip.toml").read_text().replace('unknown = ["C"]', "")
    (folder / "orip.toml").write_text(text)
    assert orip(folder, "run", "--no-report").code == 0
    held = json.loads((folder / "result.json").read_text(encoding="utf-8"))
    assert result["sigma0"] == pytest.approx(held["sigma0"], rel=1e-3)
    for name, photo in held["photos"].items():
        value, sd = photo["Z0"]["value"], photo["Z0"]["sd"]
        assert result["photos"][name]["Z0"]["value"] == pytest.approx(value, abs=0.01 * sd)


def test_what_creeps_in_vain_is_adjusted_as_long_as_it_takes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where nothing is held in the end the iterations are those without an early stop."""
    folder = level_block(tmp_path / "level", 0.2)
    assert orip(folder, "init").code == orip(folder, "measure").code == 0
    gathered = gather_bundle(block_input(read_bundle(folder, None, *ADJUSTED_FROM)))
    block = started_block(gathered, explained_preliminary_values).block
    monkeypatch.setattr(solve, "_loose", lambda _problem, _solved, held: held[:0])

    def iterations() -> list[float]:
        settings = solve.iteration_settings(block.definition)
        problem = pose_problem(block)
        found = solve.solve_problem(problem, starting_state(block), settings, lambda _: None, lambda: False)
        return [record.sigma0 for record in found.iterations]

    stopped = iterations()
    monkeypatch.setattr(solve, "_CREEPING_STEPS", 1000)
    assert len(stopped) > 25
    assert stopped == iterations()
