"""Projects that share a process, one after the other: none sees another one, and none outlives what it did wrong."""

from __future__ import annotations

import gc
import logging
import os
import pickle
import random
import re
import shutil
import signal
import sys
import threading
import time
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from workflow.small_projects import first_project, replace_in

from orip.archive import fork_server
from orip.archive.fork_server import ProjectServer, load_all
from orip.archive.simulation import simulated_project
from orip.archive.task import Limits, ProjectTask, TaskReply, TaskSettings, begin_use
from orip.archive.task import carry_out as carry_out_here
from orip.archive.worker import DIED, ENDED
from orip.files.text.atomic import write_new_folder
from orip.structs import replace

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="this system does not copy processes")

Doing = Callable[[Callable[[], object]], None]
QUICK = TaskSettings(report=False)


@pytest.fixture
def lifeline() -> Iterator[int]:
    reading, writing = os.pipe()
    yield reading
    os.close(reading)
    os.close(writing)


@pytest.fixture
def server(lifeline: int) -> Iterator[ProjectServer]:
    gc.freeze()  # copies look for circles
    yield ProjectServer(lifeline)
    gc.unfreeze()


TIMES = re.compile(rb'"(ended|head|rows|finished|seconds|cpu_seconds|peak_mb)":[^,}]*')


def files_after(top: Path, order: str, server: ProjectServer) -> dict[str, bytes]:
    """Adjust two projects in that order in one process; return all files, without times in what is kept of each."""
    first_project(top / "a")
    write_new_folder(top / "b", simulated_project(1, 0, 0.0).texts)
    replace_in(top / "b" / "orip.toml", 'ground_unit = "m"', 'crs = "EPSG:25832"')
    processes = set()
    for name in order:
        how, reply = server.adjusted(ProjectTask(name, str(top / name), str(top / "results"), QUICK))
        assert (how, pickle.loads(reply)) == (ENDED, TaskReply(name, "adjusted"))
        processes.add(server._process)
    assert len(processes) == 1
    assert None not in processes, "it takes another project"
    files = {path.relative_to(top).as_posix(): path.read_bytes() for path in top.rglob("*") if path.is_file()}
    return {name: TIMES.sub(b"", data) if name.startswith("results") else data for name, data in files.items()}


def test_projects_are_adjusted_as_if_each_were_the_first(tmp_path: Path, lifeline: int) -> None:
    load_all(QUICK)
    top = tmp_path / "archive"
    found = []
    for order in ("ab", "ba"):
        top.mkdir()
        found.append(files_after(top, order, ProjectServer(lifeline)))
        shutil.rmtree(top)
    one, other = found
    assert len(one) > 2 * 12
    assert one.keys() == other.keys()
    assert [name for name in one if one[name] != other[name]] == []


def working_directory() -> None:
    os.chdir("/")


def environment() -> None:
    os.environ["PROJECT"] = "first"


def open_file() -> None:
    os.open(os.devnull, os.O_RDONLY)


def random_numbers() -> None:
    random.random()


def warnings_shown() -> None:
    warnings.simplefilter("once")


def log() -> None:
    logging.disable(logging.CRITICAL)


def floating_point() -> None:
    np.seterr(all="raise")


def thread() -> None:
    threading.Thread(target=time.sleep, args=(60.0,), daemon=True).start()


def permissions() -> None:
    os.umask(0o000)


def killed() -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def memory_used_up() -> None:
    raise MemoryError


def endless() -> None:
    time.sleep(60.0)


TRACES = (
    working_directory, environment, open_file, random_numbers, warnings_shown, log, floating_point, thread,
    permissions,
)  # fmt: skip


@pytest.fixture
def carry_out(monkeypatch: pytest.MonkeyPatch) -> Doing:
    """Return what lets the project "faulty" do something; the message of a reply is the number of the process."""

    def does(something: Callable[[], object]) -> None:
        def carried_out(given: ProjectTask) -> TaskReply:
            if given.name == "faulty":
                something()
            return TaskReply(given.name, "adjusted", str(os.getpid()))

        monkeypatch.setattr(fork_server, "carry_out", carried_out)

    return does


def task(name: str, megabytes: int = 4000, seconds: float = 60.0) -> ProjectTask:
    return ProjectTask(name, "", "", TaskSettings(limits=Limits(seconds, megabytes)))


def process_of(server: ProjectServer, given: ProjectTask) -> str:
    """Return which process adjusts a project."""
    how, reply = server.adjusted(given)
    assert how == ENDED
    found: TaskReply = pickle.loads(reply)
    assert found.state == "adjusted"
    return found.message


@pytest.mark.parametrize("trace", TRACES)
def test_a_process_that_is_not_as_it_was_takes_no_other_project(
    trace: Callable[[], None], carry_out: Doing, server: ProjectServer
) -> None:
    carry_out(trace)
    first = process_of(server, task("one"))
    assert process_of(server, task("faulty")) == first
    third = process_of(server, task("three"))
    assert third != first
    assert process_of(server, task("four")) == third


def test_a_process_whose_memory_has_grown_takes_no_other_project(
    carry_out: Doing, server: ProjectServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    carry_out(lambda: monkeypatch.setattr(fork_server, "peak_megabytes", lambda: 60.0))
    monkeypatch.setattr(fork_server, "peak_megabytes", lambda: 40.0)
    first = process_of(server, task("one", megabytes=200))
    assert process_of(server, task("faulty", megabytes=200)) == first
    assert process_of(server, task("three", megabytes=200)) != first


def test_a_process_is_replaced_after_some_projects(
    carry_out: Doing, server: ProjectServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(fork_server, "MOST_PROJECTS", 2)
    carry_out(lambda: None)
    processes = [process_of(server, task(str(number))) for number in range(5)]
    assert processes[0] == processes[1] != processes[2] == processes[3] != processes[4]


@pytest.mark.parametrize("end", [killed, memory_used_up, endless])
def test_a_project_that_ends_its_process_leaves_the_next_one_untouched(
    end: Callable[[], None], carry_out: Doing, server: ProjectServer, tmp_path: Path
) -> None:
    carry_out(end)
    first = process_of(server, task("one"))
    folder = first_project(tmp_path / "project")
    faulty = ProjectTask("faulty", str(folder), str(tmp_path / "results"), TaskSettings(limits=Limits(0.2, 4000)))
    how, reply = server.adjusted(faulty)
    if end is killed:
        assert (how, reply) == (DIED, b"the process of the project was ended by SIGKILL")
    else:
        limit = (
            "takes longer than 0.2 s; see --time"
            if end is endless
            else "needs more than 4000 MB of memory; see --memory"
        )
        assert (how, pickle.loads(reply)) == (ENDED, TaskReply("faulty", "over limit", limit))
    second = process_of(server, task("two"))
    assert second != first
    assert process_of(server, task("three")) == second


def test_memory_that_projects_before_have_taken_does_not_count(
    server: ProjectServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    before: list[str] = []  # each process has its own

    def as_much_as_is_left(given: ProjectTask) -> TaskReply:
        if before:
            raise MemoryError
        before.append(given.name)
        return TaskReply(given.name, "adjusted", str(os.getpid()))

    monkeypatch.setattr(fork_server, "carry_out", as_much_as_is_left)
    first = process_of(server, task("one"))
    assert process_of(server, task("two")) != first


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere the limit does not count all memory")
def test_a_project_that_needs_too_much_memory_is_a_result(
    server: ProjectServer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    little = ProjectTask("little", str(first_project(tmp_path / "little")), str(tmp_path / "results"), QUICK)
    little = replace(little, settings=replace(QUICK, limits=Limits(60.0, 1)))
    over = TaskReply("little", "over limit", "needs more than 1 MB of memory; see --memory")
    with monkeypatch.context() as patch:
        # what is free in the memory that the process has already does not count: this is more
        patch.setattr(fork_server, "carry_out", lambda _: bytearray(1 << 28))
        how, reply = server.adjusted(little)
    assert (how, pickle.loads(reply)) == (ENDED, over)
    assert carry_out_here(little) == replace(over, repeated=True), "the same limit, the same end"
    enough = replace(little, settings=QUICK)
    assert carry_out_here(enough) == TaskReply("little", "adjusted"), "with more memory it is tried again"


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere it is that since the process began")
def test_the_largest_memory_is_that_since_the_project_began() -> None:
    use = begin_use()
    assert np.ones(100 << 17).all()  # 100 MB, which are free again
    with_it = use().peak_mb
    without = begin_use()().peak_mb
    assert with_it is not None
    assert without is not None
    assert without + 90.0 < with_it
