"""Mistakes in data that is well written: the first line names mistake and place, as the documentation has it."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from cli.command_line import orip
from mistakes.catalogue import CLIFF
from mistakes.data.drone import drone, in_lines, moved
from mistakes.data.mistakes import DATA_MISTAKES
from mistakes.data.simulated_projects import scale_bar_project, two_camera_project
from mistakes.data.study import BEGIN, END, row, said_of
from mistakes.edits import sample
from mistakes.first_line import DOCUMENT, first_line

LONG = {
    "moved_by_one_photo", "half_resolution", "one_portrait_photo", "another_flight", "two_height_systems",
    "antenna_offset",
}  # fmt: skip
"""Those whose runs take longest, and that are recognised as the planted ones are."""

NAMED = 2.5
"""Mean score that is asked for."""


def table() -> list[list[str]]:
    """Return the cells of the rows of the documentation's table, without its heading."""
    text = DOCUMENT.read_text(encoding="utf-8").split(BEGIN)[1].split(END)[0]
    return [line.strip("| ").split(" | ") for line in text.splitlines()[2:]]


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.long] * (name in LONG)) for name in DATA_MISTAKES]
)
def test_the_first_line_names_the_mistake(tmp_path: Path, name: str) -> None:
    mistake = DATA_MISTAKES[name]
    line = first_line([said_of(mistake, tmp_path / name)])
    assert mistake.score(line) == 3, line
    assert row(mistake, line) in DOCUMENT.read_text(encoding="utf-8"), (
        "docs/mistakes.md has another line; PYTHONPATH=tests python -m mistakes.data.study --table writes its table"
    )


def test_the_table_has_all_mistakes_and_a_sufficient_mean() -> None:
    *rows, last = table()
    assert [cells[0] for cells in rows] == [mistake.title for mistake in DATA_MISTAKES.values()]
    scores = [int(cells[1]) for cells in rows]
    assert sum(scores) / len(scores) >= NAMED
    assert last[0] == "mean"


@pytest.mark.long
def test_what_a_recognised_mistake_causes_is_not_to_be_set(tmp_path: Path) -> None:
    said = said_of(DATA_MISTAKES["moved_by_one_photo"], tmp_path / "moved").told
    assert "all off by a lever arm" in said
    assert "set lever_arm" not in said
    assert "first correct the exposure stations as the warning says" in said


@pytest.mark.parametrize("project", [drone, scale_bar_project, two_camera_project])
def test_of_the_projects_without_mistakes_nothing_is_said(tmp_path: Path, project) -> None:
    said = orip(project(tmp_path / "clean"), "run", "--no-report")
    assert said.code == 0
    (status,) = [line for line in said.out.splitlines() if line.startswith("status ")]
    assert status.startswith("status   converged")
    # of a free network is said where its origin is; nothing else
    assert not [line for line in said.err.splitlines() if re.match("error: |warning: (?!no ground |crs )", line)]


def test_positions_that_are_all_shifted_are_named_with_the_shift(tmp_path: Path) -> None:
    project = drone(tmp_path / "shifted")
    in_lines(project / "DRONE.STA", lambda words: moved(words, np.array([0.04, -0.03, 0.25])))
    said = orip(project, "run", "--no-report").told
    size = r"(\S+) ± (\S+)"
    found = re.search(f"^status .* exposure stations are all off by X {size}, Y {size}, Z {size} m", said, re.MULTILINE)
    assert found is not None, said
    x, sd_x, y, sd_y, z, sd_z = map(float, found.groups())
    assert (abs(x - 0.04) < 4.0 * sd_x, abs(y + 0.03) < 4.0 * sd_y, abs(z - 0.25) < 4.0 * sd_z) == (True,) * 3


def test_control_of_a_project_that_was_renamed_is_found_beside_it(tmp_path: Path) -> None:
    folder = sample(CLIFF, tmp_path / "renamed")
    text = (folder / "orip.toml").read_text(encoding="utf-8")
    (folder / "orip.toml").write_text(text.replace('name = "CLIFF"', 'name = "CLIFF2"', 1), encoding="utf-8")
    said = orip(folder, "run", "--no-report").err
    assert "CLIFF.PNT: this file is not read, but has coordinates of CP1" in said
    assert 'control_files = "CLIFF" in [project]' in said
