"""One project of an archive: when it is finished, what is kept of it, and what it may use."""

from __future__ import annotations

import json
import os
import pickle
import re
import signal
import sqlite3
from contextlib import closing
from pathlib import Path

import pytest
from cli.command_line import orip
from workflow.small_projects import first_project

from orip.archive import task as tasks
from orip.archive import worker
from orip.archive.run_files import ResultsFolder, name_digest, read_head, read_rows
from orip.archive.task import AS_USUAL, Limits, ProjectTask, TaskReply, TaskSettings, carry_out
from orip.bundle.methods import Method
from orip.errors import OripError
from orip.files.stores.identity import OLDER_STORES
from orip.structs import replace
from orip.version import __version__

QUICK = TaskSettings(report=False)


@pytest.fixture
def task(tmp_path: Path) -> ProjectTask:
    folder = first_project(tmp_path / "project")
    return ProjectTask("some/project", str(folder), str(tmp_path / "results"), QUICK)


def rows(task: ProjectTask) -> dict[str, list[dict[str, object]]]:
    ((_, found),) = read_rows(ResultsFolder(Path(task.results)), name_digest(task.name)[0])
    return found


def test_a_finished_project_is_not_adjusted_again(task: ProjectTask) -> None:
    assert carry_out(task) == TaskReply(task.name, "adjusted")
    assert carry_out(task).repeated
    assert carry_out(replace(task, settings=replace(QUICK, method=Method(prune=True)))) == TaskReply(
        task.name, "adjusted"
    )
    assert not carry_out(task).repeated, "it was adjusted by another method meanwhile"
    assert not carry_out(replace(task, settings=replace(QUICK, again=True))).repeated


def test_a_changed_text_is_noticed(task: ProjectTask) -> None:
    carry_out(task)
    for name, comment in {"FIRST.PNT": "!", "FIRST.MEA": "!", "orip.toml": "#"}.items():
        path = Path(task.folder, name)
        path.write_text(f"{path.read_text()}\n{comment} other\n")
        assert not carry_out(task).repeated, name


def test_a_missing_result_and_a_changed_store_are_noticed(task: ProjectTask) -> None:
    carry_out(task)
    Path(task.folder, "result.json").unlink()
    assert not carry_out(task).repeated
    assert orip(Path(task.folder), "-q", "bundle", "edit", "MAIN", "measurement_precision=0.01").code == 0
    assert not carry_out(task).repeated


def test_stores_of_an_older_orip_are_set_aside_and_made_again(task: ProjectTask) -> None:
    carry_out(task)
    wanted, folder = rows(task), Path(task.folder)
    for kind in ("PHO", "EXT"):
        (path,) = folder.glob(f"*.{kind}")
        with closing(sqlite3.connect(path)) as store:
            store.execute("PRAGMA user_version = 11")
    refused = orip(folder, "run")
    assert refused.code == 3
    assert re.search(r"error: \S+\.PHO, \S+\.EXT: these stores were written by an older orip", refused.err)
    reply = carry_out(task)
    assert reply.state == "adjusted"
    assert reply.message.startswith("2 stores of an older orip made again from the texts")
    assert len(list((folder / OLDER_STORES).iterdir())) == 2
    assert carry_out(task) == replace(reply, repeated=True)
    found = rows(task)
    assert {name: found[name] for name in ("photos", "points")} == {name: wanted[name] for name in ("photos", "points")}


def test_an_error_is_a_result_with_its_first_line(task: ProjectTask) -> None:
    path = Path(task.folder, "FIRST.PNT")
    path.write_text(path.read_text() + "P9 1 2 three 0.1 0.1 0.1\nP8 1\n")
    reply = carry_out(task)
    assert reply.state == "wrong"
    assert reply.message.startswith("FIRST.PNT:")
    assert rows(task)["projects"] == [{"project": task.name, "bundle": "", "state": "wrong", "message": reply.message}]
    assert carry_out(task).repeated
    path.write_text("".join(path.read_text().splitlines(keepends=True)[:-2]))
    assert carry_out(task) == TaskReply(task.name, "adjusted")


def test_rows_are_those_of_the_solution(task: ProjectTask) -> None:
    carry_out(replace(task, settings=replace(QUICK, gates=("sigma0<=1e-9",))))
    result = json.loads(Path(task.folder, "result.json").read_text())
    found = rows(task)
    (project,) = found["projects"]
    assert (project["bundle"], project["sigma0"], project["gates_failed"]) == ("MAIN", result["sigma0"], 1)
    assert found["gates"][0]["passed"] is False
    assert [row["photo"] for row in found["photos"]] == list(result["photos"])
    assert [row["X"] for row in found["points"]] == [point["X"]["value"] for point in result["points"].values()]
    assert found["runs"][0]["orip"] == __version__


def test_what_the_machine_is_to_blame_for_is_not_kept(task: ProjectTask, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> None:
        message = "disk cannot be written: no space left"
        raise OripError(message) from OSError(28, "no space left")

    monkeypatch.setattr(tasks, "run", full)
    assert carry_out(task).state == "machine"
    assert read_head(ResultsFolder(Path(task.results)), task.name) is None


def test_an_internal_error_does_not_end_the_archive(task: ProjectTask, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tasks, "run", lambda *_: 1 / 0)
    assert carry_out(task).message.startswith("internal error: ZeroDivisionError")


def asked(task: ProjectTask) -> TaskReply:
    found: TaskReply = pickle.loads(worker.run_project(__version__, pickle.dumps(task)))
    return found


@pytest.mark.skipif(not hasattr(os, "fork"), reason="this system does not copy processes")
def test_each_project_has_a_process_with_limits(task: ProjectTask) -> None:
    assert asked(task) == TaskReply(task.name, "adjusted")
    again = replace(QUICK, again=True)
    short = replace(task, settings=replace(again, limits=Limits(0.01, 4000)))
    assert asked(short) == TaskReply(task.name, "over limit", "takes longer than 0.01 s; see --time")
    assert carry_out(replace(short, settings=replace(short.settings, again=False))).repeated, (
        "the same limit, the same end"
    )
    assert asked(task) == TaskReply(task.name, "adjusted"), "with more time it is tried again"
    server = worker._of_thread.server._process
    os.kill(server.pid, signal.SIGKILL)
    server.wait()
    assert asked(task).repeated, "a new fork server"
    worker._of_thread.server.close()
    with pytest.raises(worker.UnfitWorkerError, match="install the same version"):
        worker.run_project("0.0", b"")


def test_the_usual_settings_have_reports() -> None:
    assert AS_USUAL.report
    assert AS_USUAL.digest != QUICK.digest
