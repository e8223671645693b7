"""Client, worker and scheduler killed in the middle: started again, the same tables in the end."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest
from cli.command_line import orip

pytest.importorskip("distributed")
pytest.importorskip("pyarrow")
pytestmark = [
    pytest.mark.long,
    pytest.mark.timeout(1800),
    pytest.mark.skipif(not hasattr(os, "fork"), reason="this system does not copy processes"),
]

PROJECTS = 24
DERIVED = ("projects", "gates", "cameras", "photos", "points")
"""The tables that do not depend on when and where a project was adjusted."""

Process = subprocess.Popen[str]


@pytest.fixture
def archive(tmp_path: Path) -> Path:
    assert orip(tmp_path, "-q", "archive", "simulate", str(PROJECTS), "surveys", "--faults", "0.3").code == 0
    return tmp_path


@pytest.fixture
def started() -> Iterator[Callable[..., Process]]:
    """Return what starts a program that is ended with the test."""
    with ExitStack() as stack:

        def start(*words: str) -> Process:
            process = subprocess.Popen(
                [sys.executable, "-m", *words], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
            )
            stack.callback(process.communicate)
            stack.callback(process.kill)
            return process

        yield start


def run_words(folder: Path, out: str, *words: str) -> tuple[str, ...]:
    return ("orip", "-C", str(folder), "archive", "run", "surveys", "--no-report", "--json", "--out", out, *words)


def finished(folder: Path, out: str) -> int:
    return len(list((folder / out / "finished").glob("*/*.json")))


def wait_for(folder: Path, out: str, number: int, process: Process) -> None:
    """Wait until so many projects are finished."""
    while finished(folder, out) < number and process.poll() is None:
        time.sleep(0.05)


def tables(folder: Path, out: str) -> dict[str, bytes]:
    top = folder / out / "tables"
    return {
        str(path.relative_to(top)): path.read_bytes() for table in DERIVED for path in (top / table).rglob("*.parquet")
    }


def test_a_killed_client_is_taken_up_again(archive: Path, started: Callable[..., Process]) -> None:
    for number in (1, 5, 11, 17):
        process = started(*run_words(archive, "killed"))
        wait_for(archive, "killed", number, process)
        process.send_signal(signal.SIGKILL)
        process.communicate()
        before = finished(archive, "killed")
        status = orip(archive, "--json", "archive", "status", "killed").document
        assert not status["running"]
        assert sum(status["states"].values()) == before
    last = started(*run_words(archive, "killed"))
    document = json.loads(last.communicate()[0])
    assert last.returncode == 0
    assert document["finished_before"] >= before
    whole = started(*run_words(archive, "whole", "--again"))
    whole.communicate()
    assert tables(archive, "killed") == tables(archive, "whole")


def test_killed_workers_and_schedulers_over_tcp(archive: Path, started: Callable[..., Process]) -> None:
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    address = f"tcp://127.0.0.1:{port}"
    scheduler_words = ("distributed.cli.dask_scheduler", "--host", "127.0.0.1", "--port", str(port), "--no-dashboard")
    worker_words = ("distributed.cli.dask_worker", address, "--nthreads", "1", "--no-nanny", "--no-dashboard")
    scheduler = started(*scheduler_words)
    workers = [started(*worker_words), started(*worker_words)]
    client = started(*run_words(archive, "killed", "--dask", address))
    for number in (2, 6, 9):
        wait_for(archive, "killed", number, client)
        workers.pop(0).kill()
        workers.append(started(*worker_words))
    wait_for(archive, "killed", 13, client)
    scheduler.kill()
    _, said = client.communicate(timeout=120)
    assert client.returncode == 1
    assert f"the scheduler at {address} no longer answers" in said
    assert "Traceback" not in said
    lost = started(*run_words(archive, "killed", "--dask", address))
    assert "no scheduler answers at" in lost.communicate(timeout=120)[1]
    for worker in workers:
        worker.kill()
    before = finished(archive, "killed")
    assert 13 <= before < PROJECTS
    started(*scheduler_words)
    started(*worker_words)
    again = started(*run_words(archive, "killed", "--dask", address))
    document = json.loads(again.communicate(timeout=600)[0])
    assert again.returncode == 0
    assert document["finished_before"] >= before
    assert "machine" not in document["states"]
    whole = started(*run_words(archive, "whole", "--again"))
    whole.communicate(timeout=600)
    assert tables(archive, "killed") == tables(archive, "whole")
