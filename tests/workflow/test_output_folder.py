"""Outputs in a folder of their own: what goes there, what stays, and that all commands look for it there."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from cli.command_line import orip
from support.driven_projects import ZURICH_MODELS, add_models
from workflow.small_projects import film_project, replace_in

from orip.files.text.atomic import temporary_beside

OUTPUTS = {
    "BUNDLE_ERROR.OUT", "BUNDLE_RESULT.OUT", "INTERIOR_RESULT.OUT", "PRELIM_RESULT.OUT", "report.html",
    "residuals.csv", "result.json",
}  # fmt: skip


def with_folder(folder: Path, name: str = "results") -> Path:
    text = (folder / "orip.toml").read_text(encoding="utf-8")
    # the table is written in braces or below its header
    begin, rest = re.split(r"(?<=project = \{)|(?<=\[project\]\n)", text, maxsplit=1)
    between = "," if begin.endswith("{") else "\n"
    (folder / "orip.toml").write_text(f'{begin} output_folder = "{name}"{between}{rest}', encoding="utf-8")
    return folder


def names_in(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()}


@pytest.fixture
def project(tmp_path: Path) -> Path:
    return with_folder(film_project(tmp_path / "film"))


def test_all_outputs_are_there_and_nothing_else(project: Path) -> None:
    texts = names_in(project)
    assert orip(project, "run").code == 0
    assert orip(project, "prelim").code == 0
    assert names_in(project / "results") == OUTPUTS
    stores = {
        path.name for path in project.iterdir() if path.suffix in {".CAM", ".TIK", ".PHO", ".TEM", ".EXT", ".EXO"}
    }
    assert names_in(project) == texts | stores | {"results", "MAIN.PRE"}
    assert "wrote    results/report.html" in orip(project, "report").out


def test_commands_look_for_them_there(project: Path) -> None:
    orip(project, "run")
    assert "everything is up to date" in orip(project, "status").out
    result = (project / "results" / "result.json").read_text()
    (project / "results" / "result.json").unlink()
    assert "everything is up to date" not in orip(project, "status").out
    assert orip(project, "init").code == 0
    assert (project / "results" / "result.json").read_text() == result
    assert orip(project, "compare", ".", "results").code == 0
    assert orip(project, "update", "points").code == 0
    assert orip(project, "update", "--undo").code == 0
    assert names_in(project / "results") <= OUTPUTS


def test_another_folder_gets_all_that_is_in_the_stores(project: Path) -> None:
    orip(project, "run")
    replace_in(project / "orip.toml", '"results"', '"elsewhere"')
    assert orip(project, "run").code == 0
    assert names_in(project / "elsewhere") >= OUTPUTS - {"PRELIM_RESULT.OUT"}
    exported = orip(project, "export-toml").out
    assert 'output_folder = "elsewhere"' in exported


def test_what_a_killed_run_has_left_there_is_removed(project: Path) -> None:
    orip(project, "run")
    left = temporary_beside(project / "results" / "result.json")
    # of a process of this machine that has ended: no process has the number 0
    left = left.with_name("-".join([*left.name.split("-")[:2], "0", *left.name.split("-")[3:]]))
    left.write_text("half a result")
    orip(project, "report")
    assert not left.exists()


def test_the_drive_table_is_there_too(tmp_path: Path) -> None:
    orip(tmp_path, "init", "--sample", "zurich_city_hall", "zurich")
    folder = add_models(with_folder(tmp_path / "zurich"), ZURICH_MODELS)
    assert orip(folder, "run", "--no-report").code == 0
    assert (folder / "results" / "MAIN.DRV").is_file()
    assert not (folder / "MAIN.DRV").exists()
    assert "kept     results/MAIN.DRV" in orip(folder, "drive", "table").err


@pytest.mark.parametrize("name", ["../elsewhere", "a/b", "", "..", "/tmp/results", "a b"])
def test_it_is_one_folder_in_the_project(tmp_path: Path, name: str) -> None:
    folder = with_folder(film_project(tmp_path / "film"), name)
    said = orip(folder, "run")
    assert said.code == 3
    assert f"output_folder '{name}'" in said.err
    assert 'write the name of a folder in that of the project, such as "results"' in said.err


def test_a_link_out_of_the_project_is_refused(project: Path, tmp_path: Path) -> None:
    (tmp_path / "beside").mkdir()
    (project / "results").symlink_to(tmp_path / "beside")
    said = orip(project, "run")
    assert said.code == 1
    assert "'results' is a link to" in said.err
    assert names_in(tmp_path / "beside") == set()
