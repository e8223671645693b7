"""`orip status` after each kind of change: what is out of date, why, and what brings it up to date."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path
from unittest.mock import patch

import pytest
from workflow.commands import initialise, measure, project_status
from workflow.quiet import run_quietly, solve_quietly
from workflow.small_projects import contents, film_project, replace_in

INIT, MEASURE, SOLVE = "orip init", "orip measure", "orip solve"


@pytest.fixture(scope="module")
def film(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = film_project(tmp_path_factory.mktemp("status") / "film")
    run_quietly(folder)
    return folder


@pytest.fixture
def project(film: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(film, tmp_path / "film"))


def outdated(folder: Path) -> dict[str, str]:
    """Return the steps that are not up to date, and why; looking changes nothing."""
    before = contents(folder)
    steps = project_status(folder).steps
    assert contents(folder) == before
    return {step.command: step.text for step in steps if step.state != "up to date"}


def change(name: str, old: str, new: str) -> Callable[[Path], None]:
    return lambda folder: replace_in(folder / name, old, new)


def remove(name: str) -> Callable[[Path], None]:
    return lambda folder: (folder / name).unlink()


CHANGES: dict[str, tuple[Callable[[Path], None], dict[str, str]]] = {
    "comment in orip.toml": (change("orip.toml", "[[photo]]", "# a comment\n[[photo]]"), {}),
    "camera": (change("orip.toml", "c = 35.0", "c = 35.1"), {INIT: "to be applied to the stores: 1 camera changed"}),
    "user": (
        change("orip.toml", '"FIRST" }', '"FIRST", user = "me" }'),
        {MEASURE: "changed since: [project] of orip.toml", SOLVE: "changed since: [project] of orip.toml"},
    ),
    "control": (change("FIRST.PNT", "1012.40", "1012.41"), {SOLVE: "changed since: FIRST.PNT"}),
    "no control": (remove("FIRST.PNT"), {SOLVE: "changed since: FIRST.PNT"}),
    "measurement": (change("FIRST.MEA", "P1 ", "P2 "), {MEASURE: "changed since: FIRST.MEA"}),
    "new measurements": (
        lambda folder: (folder / "NEW.MEA").write_text("POINTS MAIN left\nP9 100 100\n"),
        {MEASURE: "changed since: NEW.MEA"},
    ),
    "new coordinates": (
        lambda folder: (folder / "MAIN.PRE").write_text("P1 1100 2075 100\n"),
        {SOLVE: "changed since: MAIN.PRE"},
    ),
    "no result": (
        remove("result.json"),
        {SOLVE: "missing or older than the last adjustment: result.json, residuals.csv"},
    ),
    "no residuals": (remove("residuals.csv"), {SOLVE: "missing or older than the last adjustment: residuals.csv"}),
    "no listing": (
        remove("BUNDLE_RESULT.OUT"),
        {SOLVE: "missing or older than the last adjustment: BUNDLE_RESULT.OUT"},
    ),
    "no interior listing": (remove("INTERIOR_RESULT.OUT"), {MEASURE: "INTERIOR_RESULT.OUT is missing"}),
    "no cameras": (remove("CAMERAS.CAM"), {INIT: "1 camera added", MEASURE: "fiducial", SOLVE: "CAMERAS.CAM"}),
    "no photo points": (remove("MAIN.EXO"), {MEASURE: "some of its stores are missing", SOLVE: "no longer exist"}),
    "no templates": (remove("FIRST.TEM"), {MEASURE: "some of its stores are missing"}),
    "no solution": (
        remove("FIRST.EXT"),
        {INIT: "to be applied to the stores: 1 bundle added", SOLVE: "bundle MAIN has not been adjusted"},
    ),
}


@pytest.mark.parametrize("name", CHANGES)
def test_a_change_is_named_and_run_takes_it_in(project: Path, name: str) -> None:
    make, expected = CHANGES[name]
    make(project)
    found = outdated(project)
    assert set(found) == set(expected)
    for command, text in expected.items():
        assert text in found[command]
    run_quietly(project)
    left = outdated(project)
    if name == "no control":
        assert left.pop(SOLVE).startswith("not determined")
    assert left == {}


def test_each_step_makes_the_next_one_due(project: Path) -> None:
    replace_in(project / "orip.toml", "x = -18.0", "x = -18.01")
    assert set(outdated(project)) == {INIT}
    assert project_status(project).next_command == INIT
    initialise(project)
    assert set(outdated(project)) == {MEASURE, SOLVE}
    measure(project)
    assert set(outdated(project)) == {SOLVE}
    solve_quietly(project)
    assert outdated(project) == {}
    assert project_status(project).next_command is None


def test_an_adjustment_that_did_not_converge_is_not_up_to_date(project: Path) -> None:
    settings = "max_iterations = 2\nenp_stop = 300"
    replace_in(project / "orip.toml", '[[bundle]]\nname = "MAIN"', f'[[bundle]]\nname = "MAIN"\n{settings}')
    run_quietly(project)
    status = project_status(project)
    assert [(step.command, step.state) for step in status.steps if step.state != "up to date"] == [(SOLVE, "failed")]
    assert status.next_command == "orip report"


@pytest.mark.parametrize("command", [initialise, measure, solve_quietly, run_quietly])
@pytest.mark.parametrize("lost", [("residuals.csv",), ("result.json", "BUNDLE_ERROR.OUT"), ("INTERIOR_RESULT.OUT",)])
def test_the_next_command_rewrites_lost_outputs(
    project: Path, command: Callable[[Path], object], lost: tuple[str, ...]
) -> None:
    before = contents(project)
    for name in lost:
        (project / name).unlink()
    command(project)
    assert contents(project) == before


def test_killed_between_commit_and_outputs(project: Path) -> None:
    before = contents(project)
    replace_in(project / "FIRST.PNT", "1012.40", "1012.41")
    with (
        patch("orip.workflow.project.commit.write_output", side_effect=KeyboardInterrupt),
        pytest.raises(KeyboardInterrupt),
    ):
        solve_quietly(project)
    after = contents(project)
    assert after["result.json"] == before["result.json"]
    assert after["FIRST.EXT"] != before["FIRST.EXT"]
    assert (
        "missing or older than the last adjustment: BUNDLE_RESULT.OUT, BUNDLE_ERROR.OUT, result.json"
        in outdated(project)[SOLVE]
    )
    initialise(project)
    assert outdated(project) == {}
    written = contents(project)
    solve_quietly(project)
    assert contents(project) == written


def test_another_run_between_reading_and_writing(project: Path) -> None:
    from orip.errors import LockedError
    from orip.interior.replay import replay

    replace_in(project / "FIRST.MEA", "P1 ", "P2 ")
    before = contents(project)

    def meanwhile(*arguments: object) -> object:
        replace_in(project / "orip.toml", "c = 35.0", "c = 35.1")
        initialise(project)
        return replay(*arguments)  # type: ignore[arg-type]

    with (
        patch("orip.workflow.observations.measure.replay", meanwhile),
        pytest.raises(LockedError, match="repeat the command"),
    ):
        measure(project)
    assert contents(project)["MAIN.EXO"] == before["MAIN.EXO"]
    measure(project)
    assert set(outdated(project)) == {SOLVE}
