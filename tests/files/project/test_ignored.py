"""The .gitignore of a project: git keeps what a user writes, and none of what orip makes of it."""

from __future__ import annotations

from fnmatch import fnmatchcase
from pathlib import Path

import pytest
from cli.command_line import orip
from workflow.small_projects import contents, film_project, first_project, many_bundles

from orip.files.project.file_names import IGNORED

PATTERNS = [line for line in IGNORED.splitlines() if line and not line.startswith("#")]
WRITTEN_BY_USERS = (
    "orip.toml", "FIRST.PNT", "FIRST.ELE", "FIRST.LEN", "FIRST.DIR", "FIRST.CON", "FIRST.STA", "FIRST.MEA", "EDITS.MEA",
    "MAIN.PRE", "names.csv", "exchange.toml", "README.md", ".gitignore",
)  # fmt: skip
"""All texts of a project that docs/reference/files.md names."""


def is_ignored(name: str) -> bool:
    """Tell whether git leaves a file out: in patterns without a slash, * stands for what it does in file names."""
    return any(fnmatchcase(name, pattern) for pattern in PATTERNS)


def made_by(folder: Path, *commands: str) -> set[str]:
    """Return the names of the files that commands add to a folder."""
    before = set(contents(folder))
    for command in commands:
        assert orip(folder, *command.split()).code == 0, command
    return set(contents(folder)) - before


def test_texts_are_kept() -> None:
    assert [name for name in WRITTEN_BY_USERS if is_ignored(name)] == []


def test_all_that_is_made_of_a_project_on_film_is_ignored(tmp_path: Path) -> None:
    folder = film_project(tmp_path / "film")
    made = made_by(folder, "run", "prelim", "update photos")
    assert {"CAMERAS.CAM", "INTERIOR_RESULT.OUT", "result.json", "report.html", "before_update.json"} <= made
    assert {name for name in made if not is_ignored(name)} <= {"MAIN.PRE"}, "preliminary coordinates are a text"


def test_all_outputs_of_several_bundles_are_ignored(tmp_path: Path) -> None:
    made = made_by(many_bundles(first_project(tmp_path / "many"), ["A", "B"]), "run")
    assert sum(name.endswith("_result.json") for name in made) == 2
    assert [name for name in made if not is_ignored(name)] == []


def test_a_new_project_has_it(tmp_path: Path) -> None:
    assert orip(tmp_path, "init", "PIT", "pit").code == 0
    assert (tmp_path / "pit" / ".gitignore").read_text(encoding="utf-8") == IGNORED


@pytest.mark.parametrize("mine", ["*.log\n", ""])
def test_one_that_is_there_stays_as_it_is(tmp_path: Path, mine: str) -> None:
    (tmp_path / ".gitignore").write_text(mine, encoding="utf-8")
    assert orip(tmp_path, "init", "PIT", ".").code == 0
    assert (tmp_path / ".gitignore").read_text(encoding="utf-8") == mine
