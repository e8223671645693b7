"""Each command: what it does, says and writes when all is well, and again when nothing has changed."""

from __future__ import annotations

import io
from pathlib import Path
from unittest.mock import patch

import pytest
from cli.command_line import orip
from workflow.small_projects import contents, film_project, first_project, replace_in, two_bundles

from orip.bundle.compiled.photo_loop import is_compiled

STORES = ["CAMERAS.CAM", "TEMTICKS.TIK", "FIRST.PHO", "FIRST.TEM", "FIRST.EXT", "MAIN.EXO"]
OUTPUTS = [
    "INTERIOR_RESULT.OUT",
    "BUNDLE_RESULT.OUT",
    "BUNDLE_ERROR.OUT",
    "result.json",
    "residuals.csv",
    "report.html",
]


def test_run_does_the_whole_project(project: Path) -> None:
    said = orip(project, "run")
    assert said.code == 0
    for beginning in ("init     1 camera added", "measure  10 photo points", "solve    MAIN"):
        assert beginning in said.err, "how far it is"
    assert said.out.startswith("status   converged"), "the result, which 'orip run > log' keeps"
    assert said.out.splitlines()[-1].startswith("wrote    report.html")
    assert orip(project, "-q", "run").out == ""
    assert set(contents(project)) == {"orip.toml", "FIRST.PNT", "FIRST.MEA", *STORES, *OUTPUTS}


def test_step_by_step_gives_what_run_gives(tmp_path: Path) -> None:
    at_once, in_steps = first_project(tmp_path / "a"), first_project(tmp_path / "b")
    assert orip(at_once, "run").code == 0
    for command in ("init", "measure", "solve"):
        assert orip(in_steps, command).code == 0
    for name in OUTPUTS:
        assert (at_once / name).read_bytes() == (in_steps / name).read_bytes()
    for name in STORES:
        assert orip(at_once, "dump", name).out == orip(in_steps, "dump", name).out


@pytest.mark.parametrize("make", [first_project, film_project, two_bundles])
@pytest.mark.parametrize("command", ["init", "measure", "run"])
def test_unchanged_input_leaves_every_byte(tmp_path: Path, make: object, command: str) -> None:
    folder = make(tmp_path / "p")  # type: ignore[operator]
    assert orip(folder, "run").code == 0
    before = contents(folder)
    said = orip(folder, command)
    assert said.code == 0
    assert "unchanged" in said.err
    assert contents(folder) == before


def test_solve_again_leaves_every_byte_and_says_so(project: Path) -> None:
    orip(project, "run")
    before = contents(project)
    said = orip(project, "solve")
    assert "status   converged" in said.out
    assert "; unchanged: the store holds this solution already" in said.out
    assert contents(project) == before


def test_json_of_each_command(project: Path) -> None:
    init = orip(project, "init", "--json").document
    assert init["command"] == "init"
    assert not init["unchanged"]
    assert {"kind": "camera", "name": "C35", "action": "added"} in init["changes"]
    measure = orip(project, "--json", "measure").document
    assert measure["points"] == {"MAIN": 10}
    assert measure["files"] == ["FIRST.MEA"]
    solve = orip(project, "solve", "--json")
    assert solve.out == (project / "result.json").read_text()
    assert orip(project, "run", "--json").out == solve.out
    status = orip(project, "status", "--json").document
    assert [step["state"] for step in status["steps"]] == ["up to date"] * 3
    assert status["next"] is None
    for what in ("cameras", "photos", "points"):
        shown = orip(project, "results", what, "--json").document
        assert shown[what] == solve.document[what]
    residuals = orip(project, "results", "residuals", "--json").document["residuals"]
    assert len(residuals) == solve.document["observations"]


def test_results_as_text(project: Path) -> None:
    orip(project, "run")
    assert "C35" in orip(project, "results", "cameras").out
    one = orip(project, "results", "photos", "LEFT").out
    assert "left" in one
    assert "right" not in one
    assert orip(project, "results", "points", "P1").out.count("P1") == 1
    assert orip(project, "results", "residuals", "right").out.count("right") == 10


def test_orip_alone_shows_the_status(project: Path) -> None:
    assert orip(project).out == orip(project, "status").out
    assert "next     orip run" in orip(project).out


def test_verbose_status_says_which_loop_is_in_use(project: Path) -> None:
    assert "loop     " not in orip(project, "status").out
    said = orip(project, "--verbose", "status").out
    assert ("loop     compiled" in said) == is_compiled()
    assert ("loop     NumPy" in said) != is_compiled()


def test_dump_and_load(project: Path, tmp_path: Path) -> None:
    orip(project, "run")
    for name in STORES:
        dumped = orip(project, "dump", name)
        assert dumped.code == 0
        (project / "dump.txt").write_text(dumped.out, encoding="utf-8")
        (project / name).unlink()
        assert orip(project, "load", name, "dump.txt").code == 0
        assert orip(project, "dump", name).out == dumped.out
    with patch("sys.stdin", io.StringIO(dumped.out)):
        assert orip(project, "load", name).code == 0
    assert "nothing: everything is up to date" in orip(project, "status").out


def test_measure_of_named_files_is_on_top_and_relative_to_the_folder(project: Path) -> None:
    orip(project, "run")
    (project / "more.txt").write_text("POINTS MAIN left\n P2 3000 2000\n P1 3733.6 1845.0\n")
    said = orip(project, "measure", "more.txt")
    assert said.code == 0
    assert "11 photo points of MAIN, 1 measured again" in said.err
    assert "warning: more.txt is not among the project's measurement_files" in said.err
    assert "orip measure  out of date  changed since: more.txt" in orip(project, "status").out
    assert "10 photo points" in orip(project, "measure").err


def test_two_bundles_have_their_own_files(tmp_path: Path) -> None:
    folder = two_bundles(tmp_path / "p")
    said = orip(folder, "run", "--json")
    assert [record["bundle"] for record in said.document["results"]] == ["AGAIN", "MAIN"]
    for bundle in ("AGAIN", "MAIN"):
        for ending in ("_RESULT.OUT", "_ERROR.OUT", "_result.json", "_residuals.csv", ".EXO"):
            assert (folder / f"{bundle}{ending}").is_file()
    assert not {"result.json", "residuals.csv", "BUNDLE_RESULT.OUT"} & set(contents(folder))
    refused = orip(folder, "solve")
    assert refused.code == 2
    assert "the project has 2 bundles; name one of them: AGAIN, MAIN" in refused.err
    assert orip(folder, "solve", "again").code == 0
    assert orip(folder, "results", "points", "--bundle", "main").code == 0
    assert orip(folder, "results", "points").code == 2
    assert "orip solve AGAIN" in orip(folder, "status").out


def test_outputs_of_the_time_with_one_bundle_are_named(tmp_path: Path) -> None:
    folder = first_project(tmp_path / "p")
    orip(folder, "run")
    two_bundles(folder)
    orip(folder, "run")
    assert (folder / "MAIN_result.json").is_file()
    assert "warning: result.json: was written when the project had another number of bundles" in orip(folder).err


def test_carriage_returns_and_names_beyond_ascii(tmp_path: Path) -> None:
    folder = first_project(tmp_path / "Fjällräven ü")
    for name, old, new in (
        ("orip.toml", '"left"', '"sté"'),
        ("FIRST.MEA", "MAIN left", "MAIN sté"),
        ("FIRST.MEA", "P1", "Ä1"),
    ):
        replace_in(folder / name, old, new)
    for name in ("orip.toml", "FIRST.MEA", "FIRST.PNT"):
        path = folder / name
        path.write_bytes(path.read_bytes().replace(b"\n", b"\r\n"))
    assert orip(folder, "run").code == 0
    assert "Ä1" in orip(folder, "results", "points").out
    assert "sté" in orip(folder, "results", "photos", "STÉ").out


def test_two_runs_in_different_folders_are_equal_to_the_byte(tmp_path: Path) -> None:
    one, other = film_project(tmp_path / "one"), film_project(tmp_path / "other")
    assert orip(one, "run").code == orip(other, "run").code == 0
    for name in OUTPUTS:
        assert (one / name).read_bytes() == (other / name).read_bytes()
