"""`orip archive` from the command line: a run, taken up again, and what is said of wrong words."""

from __future__ import annotations

import hashlib
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from cli.command_line import orip
from support.json_schemas import schema_faults
from workflow.small_projects import first_project

from orip.archive.cluster.connection import WorkerFacts, require_fit_workers, worker_facts
from orip.archive.run_files import ResultsFolder
from orip.archive.tables import SCHEMA
from orip.errors import OripError
from orip.files.text.own_files import locked

pytest.importorskip("distributed")
pytest.importorskip("pyarrow")

needs_fork = pytest.mark.skipif(not hasattr(os, "fork"), reason="this system does not copy processes")


def run(folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    """Run orip as its users do: Dask has threads and warnings of its own."""
    return subprocess.run(
        [sys.executable, "-m", "orip", "-C", str(folder), *words],
        capture_output=True,
        text=True,
        check=False,
        timeout=120,
    )


@needs_fork
@pytest.mark.slow
def test_a_run_on_this_machine(tmp_path: Path) -> None:
    pytest.importorskip("cryptography")
    for name in ("a", "b", "c"):
        (tmp_path / "surveys" / name).mkdir(parents=True)
        first_project(tmp_path / "surveys" / name)
    (tmp_path / "surveys" / "b" / "FIRST.PNT").write_text("P1 one 2 3 0.1 0.1 0.1\n")
    first = run(tmp_path, "archive", "run", "surveys", "--no-report", "--json", "--workers", "1")
    assert first.returncode == 0, first.stderr
    assert json.loads(first.stdout)["states"] == {"adjusted": 2, "wrong": 1}
    assert "dashboard" not in first.stderr
    assert "wrong    b: FIRST.PNT:1" in first.stderr
    assert "Traceback" not in first.stderr
    status = orip(tmp_path, "--json", "archive", "status").document
    assert (status["projects"], status["running"]) == (3, False)
    assert [row["project"] for row in status["not_adjusted"]] == ["b"]
    report = orip(tmp_path, "--json", "archive", "report").document
    assert report["rows"]["projects"] == 3
    for document in (json.loads(first.stdout), status, report):
        assert schema_faults(document) == []
    assert "finished" in orip(tmp_path, "archive", "status").out


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("run", "missing"), "there is no folder"),
        (("run", "."), "no project below"),
        (("run", ".", "--dask", "tcp://127.0.0.1:9", "--workers", "2"), "give one of them"),
        (("run", ".", "--check", "sigma0"), "sigma0"),
        (("status",), "holds no results of an archive"),
        (("report", "nothing"), "holds no results of an archive"),
        (("diff", "nothing", "nowhere"), "holds no results of an archive"),
    ],
)
def test_wrong_words_are_refused(tmp_path: Path, words: tuple[str, ...], said: str) -> None:
    found = orip(tmp_path, "archive", *words)
    assert found.code == 2
    assert said in found.err


def test_a_run_that_is_only_starting_is_told(tmp_path: Path) -> None:
    lock = ResultsFolder(tmp_path / "archive_results").lock
    lock.parent.mkdir()
    lock.touch()
    with locked(lock, "results"):
        found = orip(tmp_path, "archive", "status")
    assert found.code == 6
    assert "is starting its workers; ask again in a few seconds" in found.err


def test_damaged_results_are_named(tmp_path: Path) -> None:
    (tmp_path / "archive_results").mkdir()
    (tmp_path / "archive_results" / "archive.json").write_text('{"schema": "orip.archive/99"}')
    found = orip(tmp_path, "archive", "status")
    assert found.code == 3
    assert "orip.archive/99" in found.err


def test_help_does_not_load_dask(tmp_path: Path) -> None:
    code = "import sys; from orip.cli.main import main; sys.argv = ['orip', 'archive', '--help']\ntry: main()\n"
    code += "except SystemExit: print(sorted({'dask', 'distributed', 'pyarrow', 'numpy'} & set(sys.modules)))"
    said = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=tmp_path)
    assert said.stdout.endswith("[]\n")


@pytest.mark.parametrize("words", [("run", "."), ("report",), ("diff", "a", "b")])
def test_what_is_not_installed_is_named_with_the_way_to_get_it(tmp_path: Path, words: tuple[str, ...]) -> None:
    code = "import sys; sys.modules['pyarrow'] = sys.modules['distributed'] = None\n"
    code += f"sys.argv = {['orip', 'archive', *words]}\nfrom orip.cli.main import main; main()"
    said = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False, cwd=tmp_path)
    assert said.returncode == 2
    assert said.stderr == "error: archives need distributed and pyarrow: pip install 'orip[archive]'\n"


class Workers:
    """A client of a cluster whose workers are as given."""

    def __init__(self, **workers: object) -> None:
        self.workers = workers

    def run(self, *_: object, **__: object) -> dict[str, object]:
        return self.workers


def test_workers_that_do_not_fit_are_named_with_all_that_is_wrong(tmp_path: Path) -> None:
    fit = worker_facts(str(tmp_path))
    marker = tmp_path / "marker"
    marker.touch()
    here = worker_facts(str(marker))
    require_fit_workers(Workers(one=here), marker, forking=True)
    other = WorkerFacts("0.0", not here.is_compiled, sees_files=False, can_fork=False)
    found_there = Workers(one=here, two=other, three=ModuleNotFoundError("No module named 'orip'"))
    with pytest.raises(OripError) as found:
        require_fit_workers(found_there, marker, forking=True)
    lines = str(found.value).splitlines()
    assert not fit.sees_files
    assert lines[0].startswith("worker three: orip cannot be loaded there (No module named 'orip'); install")
    assert [line.partition(": ")[0] for line in lines[1:]] == ["worker two"] * 4
    assert f"it has orip 0.0, and this is {here.orip}" in lines[1]
    assert "lacks the compiled loops" in lines[2]
    assert f"does not see {tmp_path}" in lines[3]


PLAN = {
    "schema": SCHEMA, "base": "/surveys\x1b[2J", "projects": ["a"], "settings": "s", "method": "", "orip": "1",
    "dashboard": "", "began": 1.0,
}  # fmt: skip
HEAD = {
    "schema": SCHEMA, "project": "a", "state": "wrong", "message": "\x1b]0;title\x07", "settings": "s", "texts": "",
    "steps": "", "ended": 2.0,
}  # fmt: skip


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="this system has no pipes with a name")
@pytest.mark.timeout(60)
def test_a_pipe_in_place_of_a_file_of_the_archive_is_not_waited_for(tmp_path: Path) -> None:
    results = ResultsFolder(tmp_path / "r")
    results.folder.mkdir()
    os.mkfifo(results.plan)
    for words in (("report", "r"), ("status", "r"), ("diff", "r", "r")):
        said = orip(tmp_path, "archive", *words)
        assert said.code == 3, said
        assert "archive.json: is a pipe (FIFO), not a file; remove it" in said.err
    results.plan.unlink()
    results.plan.write_text(json.dumps(PLAN), encoding="utf-8")
    results.project("a").parent.mkdir(parents=True)
    os.mkfifo(results.project("a"))
    assert orip(tmp_path, "--json", "archive", "status", "r").document["states"] == {}
    assert orip(tmp_path, "--json", "archive", "report", "r").document["rows"]["projects"] == 0
    table = results.table("projects", "a")
    table.unlink()
    os.mkfifo(table)
    assert (
        "rows.parquet: cannot be read: [Errno 22] this is a pipe (FIFO)"
        in orip(tmp_path, "archive", "diff", "r", "r").err
    )
    assert orip(tmp_path, "archive", "report", "r").code == 1
    results.lock.unlink(missing_ok=True)
    os.mkfifo(results.lock)
    (tmp_path / "surveys" / "a").mkdir(parents=True)
    first_project(tmp_path / "surveys" / "a")
    said = orip(tmp_path, "archive", "run", "surveys", "--out", "r", "--dask", "tcp://127.0.0.1:9")
    assert "'archive.lock' is no regular file" in said.err


@pytest.mark.parametrize("damage", [{"projects": 5}, {"began": "x"}, {"base": None}, {"schema": "\x1b[31mnone"}])
def test_a_plan_with_other_values_is_no_plan(tmp_path: Path, damage: dict[str, object]) -> None:
    (tmp_path / "archive.json").write_text(json.dumps({**PLAN, **damage}), encoding="utf-8")
    said = orip(tmp_path, "archive", "status", ".")
    assert "archive.json: holds" in said.err
    assert "\x1b" not in said.err


@pytest.mark.parametrize("text", ["[" * 100_000, "null", "{}", "\xff"])
def test_a_plan_that_is_none_is_told(tmp_path: Path, text: str) -> None:
    (tmp_path / "archive.json").write_text(text, encoding="latin-1")
    assert "archive.json: holds something else" in orip(tmp_path, "archive", "status", ".").err


def finished_text(**values: object) -> str:
    """Return what is kept of a project, as whoever knows how it is summed up could write it."""
    head = {**HEAD, "rows": hashlib.sha256(b"{}").hexdigest(), **values}
    digest = hashlib.sha256(json.dumps(head, separators=(",", ":")).encode()).hexdigest()
    return f"{json.dumps({**head, 'head': digest})}\n{{}}\n"


def test_words_of_a_foreign_archive_do_not_steer_the_terminal(tmp_path: Path) -> None:
    results = ResultsFolder(tmp_path)
    results.plan.write_text(json.dumps(PLAN), encoding="utf-8")
    results.project("a").parent.mkdir(parents=True)
    results.project("a").write_text(finished_text(), encoding="utf-8")
    said = orip(tmp_path, "archive", "status", ".").out
    assert "wrong    a: \\x1b]0;title\\x07" in said
    assert "\x1b" not in said
    results.project("a").write_text(finished_text().replace("{}", "[]"), encoding="utf-8")
    assert "is damaged; remove it, and 'orip archive run' adjusts" in orip(tmp_path, "archive", "report", ".").err
    results.project("a").write_text(finished_text(state="\x1b"), encoding="utf-8")
    assert orip(tmp_path, "--json", "archive", "status", ".").document["not_adjusted"] == []
