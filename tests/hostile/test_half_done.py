"""Commands that make a folder, killed at any step: it is whole or empty, and the same command works again."""

from __future__ import annotations

import os
import re
import shlex
import shutil
from pathlib import Path

import pytest
from cli.command_line import orip
from hostile.killing import fork
from support.long_cases import in_turn
from workflow.killed_orip import Steps
from workflow.small_projects import first_project

from orip.errors import InputError

pytestmark = pytest.mark.skipif(os.name != "posix", reason="processes are forked")

COMMANDS = ("import colmap {}/model new", "export colmap new", "export bingo new", "adjust colmap {}/model new")


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = first_project(tmp_path_factory.mktemp("made") / "p")
    assert orip(folder, "run", "--no-report").code == 0
    assert orip(folder, "export", "colmap", "model").code == 0
    return folder


@pytest.mark.parametrize(("words", "is_there"), in_turn(COMMANDS, [True, False]))
def test_killed_in_the_midst_there_is_all_or_nothing_and_the_same_command_works_again(
    words: str, is_there: bool, made: Path, tmp_path: Path
) -> None:
    place = tmp_path / "place"
    given = shlex.split(words.replace("{}", str(made)))
    shutil.copytree(made, place / "p")
    if words.startswith("adjust"):
        orip(place / "p", *given[:-1], "warm")  # loads all modules
        shutil.rmtree(place / "p" / "warm")
    assert os.waitstatus_to_exitcode(fork(_with(place / "p", is_there), given, Steps(0))) == 0
    steps, whole = int((place / "steps").read_text()), _names(place / "p" / "new")
    assert steps > 4
    for step in range(1, steps + 1, 1 + steps // (2 if words.startswith("adjust") else 6)):
        project = _with(place / "p", is_there)
        assert os.WIFSIGNALED(fork(project, given, Steps(step)))
        assert _names(project / "new") in (set(), whole), f"killed at step {step} of {steps}"
        if _names(project / "new") != whole:
            assert os.waitstatus_to_exitcode(fork(project, given, Steps(-2))) == 0, f"after step {step} of {steps}"
        assert _names(project / "new") == whole
        assert not [path for path in project.iterdir() if path.name.startswith(".orip-")]


def test_an_import_into_the_folder_one_works_in_goes_on_where_it_was_killed(
    made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    here = tmp_path / "here"
    here.mkdir()
    monkeypatch.chdir(here)
    number = here.stat().st_ino
    given = ["import", "colmap", str(made / "model"), "."]
    assert os.WIFSIGNALED(fork(here, given, Steps(5)))
    assert not (here / "orip.toml").exists()
    assert os.waitstatus_to_exitcode(fork(here, given, Steps(-2))) == 0
    assert (here / "orip.toml").exists()
    assert here.stat().st_ino == number
    assert orip(here, *given).code == 2


def test_the_permissions_of_an_empty_folder_stay(made: Path) -> None:
    (made / "private").mkdir(mode=0o700)
    assert orip(made, "export", "colmap", "private").code == 0
    assert (made / "private").stat().st_mode & 0o777 == 0o700


def _with(project: Path, is_there: bool) -> Path:
    """Put the folder back as it was before the command."""
    shutil.rmtree(project / "new", ignore_errors=True)
    if is_there:
        (project / "new").mkdir()
    return project


def _names(folder: Path) -> set[str]:
    return {str(path.relative_to(folder)) for path in folder.rglob("*")} if folder.exists() else set()


def _metashape(folder: Path, name: str, *, label: str | None = None) -> Path:
    """Write the cameras of the adjusted project; all of them with one label, if it is given."""
    assert orip(folder, "export", "metashape", name).code == 0
    path = folder / name / "cameras.xml"
    if label is not None:
        path.write_text(re.sub(r'(<camera [^>]*label=)"[^"]*"', rf'\1"{label}"', path.read_text()))
    return folder / name


@pytest.mark.parametrize("json", [(), ("--json",)])
def test_labels_that_occur_twice_are_told_before_the_adjustment(
    json: tuple[str, ...], made: Path, tmp_path: Path
) -> None:
    shutil.copytree(made, tmp_path / "p")
    source = _metashape(tmp_path / "p", "source", label="DJI_0001")
    said = orip(tmp_path, "adjust", "metashape", str(source), "out", *json)
    assert said.code == 3
    assert "the label 'DJI_0001' is that of several elements <camera>" in said.err
    assert "iterations" not in said.err
    assert not (tmp_path / "out").exists()
    if json:
        assert said.document["schema"] == "orip.error/1"


@pytest.mark.parametrize("json", [(), ("--json",)])
def test_an_adjustment_whose_export_is_refused_is_kept(
    json: tuple[str, ...], made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refused(*_: object, **__: object) -> None:
        message = "the result cannot be written back; correct it"
        raise InputError.single(message, "x")

    monkeypatch.setattr("orip.exchange.project.exported.write_export", refused)
    said = orip(tmp_path, "adjust", "colmap", str(made / "model"), "out", *json)
    assert said.code == 3
    assert "x: the result cannot be written back; correct it" in said.err
    assert "out: the project with report.html and result.json; nothing was exported" in said.err
    assert {"orip.toml", "report.html", "result.json"} <= {path.name for path in (tmp_path / "out").iterdir()}
    assert orip(tmp_path / "out", "status").code == 0
    if json:
        assert said.document["schema"].startswith("orip.result/")
