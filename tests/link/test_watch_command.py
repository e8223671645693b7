"""`orip drive watch` from its start to its end."""

from __future__ import annotations

import hashlib
import json
import os
import queue
import shutil
import signal
import socket
import subprocess
import sys
import threading
import urllib.request
import webbrowser
from contextlib import contextmanager
from pathlib import Path
from urllib.parse import urlsplit
from urllib.request import url2pathname

import pytest
from cli.command_line import orip
from link.served import loaded_station, served
from link.test_watch import watch_of
from support.driven_projects import add_models
from workflow.small_projects import contents, first_project

from orip.web import serving as watch_module
from orip.web.page_server import WatchServer


@pytest.fixture(scope="module")
def adjusted_folder(tmp_path_factory):
    found = add_models(first_project(tmp_path_factory.mktemp("watch") / "first"), [("M1", "left", "right", 1, 1)])
    assert orip(found, "run").code == 0
    (found / "MAIN.DRV").unlink(missing_ok=True)  # the command makes it
    return found


@pytest.fixture
def folder(adjusted_folder, tmp_path):
    return Path(shutil.copytree(adjusted_folder, tmp_path / "first"))


@contextmanager
def started(folder, *options):
    """Start the command and yield the process."""
    words = [sys.executable, "-m", "orip.cli.main", "-C", str(folder), "drive", "watch", "--no-open", *options]
    with subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        try:
            yield process
        finally:
            process.kill()


def fetched(url):
    with urllib.request.urlopen(url, timeout=10) as reply:  # the address is the command's own
        return json.load(reply)


@pytest.mark.parametrize("end", [signal.SIGINT, signal.SIGTERM])
def test_it_serves_until_it_is_ended(folder, end):
    with started(folder) as process:
        url = process.stdout.readline().strip()
        scene = fetched(f"{url}scene")
        assert [model["name"] for model in scene["models"]] == ["M1"]
        assert {point[1] for point in scene["plan"]["points"]} >= {"control"}
        assert len(scene["models"][0]["outline"]) > 100
        assert (folder / "MAIN.DRV").is_file()
        process.send_signal(end)
        assert process.wait(10) == 0
        assert process.stderr.read() == "Ctrl-C ends it\n"


def test_with_a_link_it_shows_the_plate_processor_there(folder):
    assert orip(folder, "drive", "table").code == 0
    table = (folder / "MAIN.DRV").read_bytes()
    station = loaded_station(table)
    assert station.digest == hashlib.sha256(table).hexdigest()
    with served(station) as port, started(folder, "--json", "--link", f"tcp://127.0.0.1:{port}") as process:
        document = "".join(process.stdout.readline() for _ in range(5))
        assert json.loads(document)["command"] == "drive watch"
        with urllib.request.urlopen(json.loads(document)["url"] + "events", timeout=10) as stream:
            state = json.loads(stream.readline().removeprefix(b"data: "))
        assert (state["model"], state["guide"]) == ("M1", "OBJECT")


def test_what_stops_it(folder, tmp_path):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        said = orip(folder, "drive", "watch", "--no-open", "--listen", f"127.0.0.1:{port}")
        assert said.code == 1
        assert f"port {port} of 127.0.0.1 cannot be taken" in said.err
    said = orip(folder, "drive", "watch", "--no-open", "--link", f"tcp://127.0.0.1:{port}")
    assert said.code == 7
    assert "no plate processor answers" in said.err
    with served() as other:  # with the table of another block
        said = orip(folder, "drive", "watch", "--no-open", "--link", f"tcp://127.0.0.1:{other}")
        assert said.code == 7
        assert "has another drive table; 'orip drive download' loads this one" in said.err
    (folder / "MAIN.DRV").write_bytes((folder / "MAIN.DRV").read_bytes().replace(b"M1", b"M2"))
    said = orip(folder, "drive", "watch", "--no-open")
    assert said.code == 3
    assert "MAIN.DRV: " in said.err
    assert "run 'orip drive table' to make it again" in said.err


def test_before_the_adjustment(tmp_path):
    folder = add_models(first_project(tmp_path / "first"), [("M1", "left", "right", 1, 1)])
    assert orip(folder, "init").code == 0
    before = contents(folder)
    said = orip(folder, "drive", "watch", "--no-open")
    assert said.code == 3
    assert "bundle MAIN has not been adjusted yet; run 'orip solve' first" in said.err
    assert contents(folder) == before


def test_the_token_is_in_no_command_that_others_see(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_RUNTIME_DIR" if os.name == "posix" else "LOCALAPPDATA", str(tmp_path))
    opened, seen = queue.Queue(), []
    monkeypatch.setattr(webbrowser, "open", opened.put)
    server = WatchServer(watch_of())

    def look():
        page = Path(url2pathname(urlsplit(opened.get(timeout=20)).path))
        seen.append((page, page.read_text(encoding="utf-8"), page.stat().st_mode & 0o777))
        server.shutdown()

    looking = threading.Thread(target=look)
    looking.start()
    with server:
        watch_module.serve_until_ended(server, browser=True)
    looking.join()
    ((page, text, mode),) = seen
    assert server.token not in str(page)
    assert f"0; url={server.url}" in text
    assert os.name != "posix" or mode == 0o600
    assert not page.exists()
