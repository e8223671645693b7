"""`orip report`, and the report that `orip solve` and `orip run` write."""

from __future__ import annotations

import hashlib
import json
import os
from pathlib import Path

import pytest
from cli.command_line import orip
from workflow.commands import project_status
from workflow.quiet import run_quietly
from workflow.small_projects import first_project, replace_in, two_bundles

from orip.report.run_mark import run_of_page


@pytest.fixture
def project(tmp_path: Path) -> Path:
    folder = first_project(tmp_path / "first")
    run_quietly(folder)
    return folder


def run_in_store(folder: Path) -> str:
    return str(json.loads((folder / "result.json").read_text())["run"])


def test_report_is_written_where_it_is_wanted(project: Path, tmp_path: Path) -> None:
    assert orip(project, "report").code == 0
    page = (project / "report.html").read_text()
    assert run_of_page(page) == run_in_store(project)
    wanted = tmp_path / "elsewhere.html"
    said = orip(project, "report", "MAIN", "--output", str(wanted))
    assert said.out.startswith(f"wrote    {wanted}")
    assert wanted.read_text() == page


def test_json_names_the_file(project: Path) -> None:
    said = orip(project, "report", "--json")
    assert said.document == {
        "schema": "orip.report/1",
        "command": "report", "run": run_in_store(project), "bundle": "MAIN", "file": "report.html",
    }  # fmt: skip


def test_solve_and_run_write_it_unless_told_not_to(project: Path) -> None:
    for command in ("solve", "run"):
        assert orip(project, command, "--no-report").code == 0
        assert not (project / "report.html").exists()
        assert "report.html" in orip(project, command).out
        (project / "report.html").unlink()


def test_gates_of_the_command_line_are_on_the_page_of_solve(project: Path) -> None:
    assert orip(project, "solve", "--check", "redundancy>=1000").code == 5
    assert "redundancy &gt;= 1000" in (project / "report.html").read_text()


def test_each_bundle_has_its_report(tmp_path: Path) -> None:
    folder = two_bundles(tmp_path / "two")
    assert orip(folder, "run").code == 0
    assert "bundle MAIN" in (folder / "MAIN_report.html").read_text()
    assert "bundle AGAIN" in (folder / "AGAIN_report.html").read_text()
    assert not (folder / "report.html").exists()


def test_without_an_adjustment_there_is_nothing_to_report(tmp_path: Path) -> None:
    folder = first_project(tmp_path / "first")
    assert orip(folder, "init").code == 0
    said = orip(folder, "report")
    assert said.code == 3
    assert "bundle MAIN has not been adjusted yet; run 'orip solve' first" in said.err
    assert not (folder / "report.html").exists()


def test_a_report_of_an_older_adjustment_is_named(project: Path) -> None:
    assert orip(project, "report").code == 0
    assert project_status(project).warnings == ()
    replace_in(project / "FIRST.PNT", "1012.40", "1012.41")
    assert orip(project, "solve", "--no-report").code == 0
    (warning,) = project_status(project).warnings
    assert str(warning) == "report.html is older than the last adjustment; 'orip report' writes it again"


def test_a_photo_that_has_got_another_camera_since_is_drawn_all_the_same(project: Path) -> None:
    assert orip(project, "camera", "copy", "C35", "OTHER").code == 0
    assert orip(project, "photo", "edit", "left", "camera=OTHER").code == 0
    said = orip(project, "report")
    assert said.code == 0


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_a_folder_that_refuses_is_named(project: Path, tmp_path: Path) -> None:
    closed = tmp_path / "closed"
    closed.mkdir(mode=0o500)
    said = orip(project, "report", "--output", str(closed / "report.html"))
    assert said.code == 1
    assert "cannot be written" in said.err


def test_a_missing_folder_is_named(project: Path, tmp_path: Path) -> None:
    said = orip(project, "report", "--output", str(tmp_path / "nowhere" / "report.html"))
    assert said.code == 1
    assert "report.html cannot be written: there is no such folder; the page alone is missing" in said.err


def test_measurement_files_are_among_the_inputs(project: Path) -> None:
    assert orip(project, "report").code == 0
    page = (project / "report.html").read_text()
    for path in project.glob("*.MEA"):
        assert hashlib.sha256(path.read_bytes()).hexdigest() in page


def test_without_a_browser_the_page_alone_is_written(project: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", str(project))
    said = orip(project, "report", "--pdf")
    assert said.code == 1
    assert "report.pdf was not written: no Chromium, Chrome or Edge was found" in said.err
    assert (project / "report.html").exists()
    assert not (project / "report.pdf").exists()


def test_the_browser_prints_the_page_that_was_written(
    project: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # a browser that writes what it was asked to print
    programs = tmp_path / "programs"
    programs.mkdir()
    (programs / "chromium").write_text(
        "#!/bin/sh\n"
        "for word; do case $word in --print-to-pdf=*) out=${word#*=};; esac; done\n"
        'echo "%PDF $word" > "$out"\n'
    )
    (programs / "chromium").chmod(0o755)
    monkeypatch.setenv("PATH", f"{programs}:/usr/bin:/bin")
    wanted = tmp_path / "client.pdf"
    said = orip(project, "report", "--pdf", "--output", str(wanted), "--json")
    assert said.document["pdf"] == str(wanted)
    assert wanted.read_text() == f"%PDF {(tmp_path / 'client.html').as_uri()}\n"
    assert run_of_page((tmp_path / "client.html").read_text()) == run_in_store(project)


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["--pdf", "--output", "client.html"], "with --pdf the file of --output is the PDF"),
        (["--output", "client.pdf"], "print it with 'orip report --pdf --output client.pdf'"),
    ],
)
def test_a_page_is_not_called_pdf_nor_replaced_by_one(tmp_path: Path, words: list[str], sentence: str) -> None:
    said = orip(first_project(tmp_path / "first"), "report", *words)
    assert said.code == 2
    assert sentence in said.err
