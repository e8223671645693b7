"""The screen under attack and accidents: guessed tokens, a flood, images that change, two screens, kills."""

from __future__ import annotations

import json
import os
import secrets
import signal
import socket
import threading
import time
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from http.client import HTTPConnection, HTTPException
from pathlib import Path
from urllib.error import URLError

import numpy as np
import pytest

Images = pytest.importorskip("PIL.Image")
pytest.importorskip("cv2")

from cli.command_line import orip  # noqa: E402  # after what it needs
from screen.rendered_project import NEW, Rendered, asked, screen_of, served  # noqa: E402

from orip.cli.terminal import Terminal  # noqa: E402
from orip.workflow.open_screen import open_screen  # noqa: E402


def guess(server, count: int) -> Counter:
    """Ask with guessed tokens over a few connections, and return what was answered."""
    found: Counter = Counter()
    connection = HTTPConnection(server.host, server.port, timeout=30)
    body = json.dumps({"photo": "P0", "point": "X", "x": 1.0, "y": 1.0})
    for number in range(count):
        token = server.token[:-1] if number % 3 == 0 else secrets.token_urlsafe(16)
        connection.request("POST", f"/{token}/measure", body, {"Content-Type": "application/json"})
        reply = connection.getresponse()
        reply.read()
        found[reply.status] += 1
    connection.close()
    return found


@pytest.mark.parametrize("count", [500, pytest.param(100_000, marks=pytest.mark.long)])
def test_a_guessed_token_is_refused_each_time(project: Path, count: int) -> None:
    with served(project) as server:
        assert guess(server, count) == {403: count}
        assert asked(server.url, "scene")[0] == 200
    assert not (project / "EDITS.MEA").exists()


@pytest.mark.parametrize("count", [500, pytest.param(10_000, marks=pytest.mark.long)])
def test_a_flood_of_requests_is_answered_or_hung_up_and_the_page_goes_on(
    project: Path, rendered: Rendered, count: int
) -> None:
    """What was answered is in the file, and no more than was asked; others have no answer."""
    x, y = rendered.pixel(0, NEW["C7"])
    statuses: Counter = Counter()
    acknowledged: list[str] = []
    lock = threading.Lock()

    def ask(number: int) -> None:
        name = f"F{number}"
        with suppress(OSError, HTTPException, URLError):
            if number % 10:
                status, _ = asked(server.url, "pictures/0/0/0/0")
            else:
                status, said = asked(server.url, "measure", {"photo": "P0", "point": name, "x": x, "y": y})
                if status == 200 and "error" not in said:
                    with lock:
                        acknowledged.append(name)
            with lock:
                statuses[status] += 1

    with served(project) as server:
        with ThreadPoolExecutor(200) as pool:
            list(pool.map(ask, range(count)))
        assert set(statuses) == {200}
        assert asked(server.url, "scene")[0] == 200
        assert asked(server.url, "pictures/1/0/0/0")[0] == 200
    written = [line.split()[0] for line in (project / "EDITS.MEA").read_text().splitlines() if line.startswith("  F")]
    assert set(acknowledged) <= set(written)
    assert len(set(written)) == len(written)
    assert len(acknowledged) > count // 100


def test_open_connections_that_say_nothing_do_not_keep_the_page_from_others(project: Path) -> None:
    with served(project) as server:
        silent = [socket.create_connection((server.host, server.port)) for _ in range(60)]
        try:
            assert asked(server.url, "scene")[0] == 200
        finally:
            for one in silent:
                one.close()


def test_images_that_change_and_vanish_under_requests_are_one_message_each(project: Path, rendered: Rendered) -> None:
    stop, path = threading.Event(), project / "images" / "P0.png"
    good = path.read_bytes()

    def disturb() -> None:
        random = np.random.default_rng(7)
        while not stop.is_set():
            kind = int(random.integers(4))
            if kind == 0:
                path.unlink(missing_ok=True)
            elif kind == 1:
                path.write_bytes(good[: int(random.integers(len(good)))])
            else:
                path.write_bytes(good)

    x, y = rendered.pixel(0, NEW["C7"])
    with served(project) as server:
        thread = threading.Thread(target=disturb)
        thread.start()
        try:
            for _ in range(60):
                for command, content in (
                    ("pictures/0/0/0/0", None), ("propose", {"photo": "P0", "point": "C7", "x": x, "y": y}),
                ):  # fmt: skip
                    status, said = asked(server.url, command, content)
                    assert status in (200, 400, 404)
                    assert status == 200 or "P0.png" in said["error"]
        finally:
            stop.set()
            thread.join()
        path.write_bytes(good)
        assert asked(server.url, "pictures/0/0/0/0")[0] == 200


def test_a_second_screen_is_refused_with_what_to_do(project: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert open_screen(project) == ""
    with screen_of(project) as (process, url):
        assert asked(url, "scene")[0] == 200
        assert open_screen(project) == url
        assert "screen   open; a terminal is told the address" in orip(project, "status").out
        monkeypatch.setattr(Terminal, "is_terminal", True)
        assert f"screen   {url}report leads to the images" in orip(project, "status").out
        for more in ((), ("--stereo",)):
            said = orip(project, "screen", "--no-open", *more)
            assert said.code != 0
            if not more:
                assert "on another screen: measure on that page ('orip status' has its address), or end" in said.err
        os.kill(process.pid, signal.SIGINT)
        process.join(20)
        assert process.exitcode == 0
    assert open_screen(project) == ""
    with screen_of(project) as (process, url):
        assert asked(url, "scene")[0] == 200
        process.kill()
        process.join(20)
        assert open_screen(project) == "", "it has left its address, and nothing else"


def contents(folder: Path) -> dict[str, bytes]:
    """Return the files of a project but for that of its measurements, whole or not yet in its place."""
    found = {str(path.relative_to(folder)): path for path in folder.rglob("*") if path.is_file()}
    return {
        name: path.read_bytes() for name, path in found.items() if name != "EDITS.MEA" and not name.endswith(".tmp")
    }


@pytest.mark.timeout(7200)
@pytest.mark.parametrize("kills", [3, pytest.param(500, marks=pytest.mark.long)])
def test_what_was_acknowledged_stays_whenever_the_screen_is_killed(
    project: Path, rendered: Rendered, kills: int
) -> None:
    """Killed at random moments: the log is whole, and has what was answered; no other file is changed."""
    x, y = rendered.pixel(0, NEW["C7"])
    before = contents(project)
    random, acknowledged, wanted, lasting = np.random.default_rng(12), [], [], 0.1
    for kill in range(kills):
        with screen_of(project) as (process, url):
            timer = threading.Timer(float(random.uniform(0.0, 1.5)) * lasting, process.kill)
            with suppress(OSError, HTTPException, URLError):
                for number in range(10_000):
                    if number == min(kill % 4, 1):  # one in four may be killed before anything is answered
                        timer.start()
                    name, began = f"K{kill}-{number}", time.monotonic()
                    wanted.append(name)
                    status, said = asked(url, "measure", {"photo": "P0", "point": name, "x": x, "y": y})
                    assert status == 200
                    assert "error" not in said
                    lasting = time.monotonic() - began
                    acknowledged.append(name)
            timer.join()
        path = project / "EDITS.MEA"
        if path.exists():
            written = [line.split()[0] for line in path.read_text().splitlines() if line.startswith("  K")]
            assert set(acknowledged) <= set(written) <= set(wanted)
            assert len(set(written)) == len(written)
        assert contents(project) == {".orip-tiles/screen": b"", **before}
    assert len(acknowledged) >= 3 * kills // 4
    said = orip(project, "measure")  # all of the log can be read
    assert said.code == 0, said.err
    assert not list(project.glob(".orip-*.tmp"))
