"""The screen under attack and accidents: guessed tokens, a flood, images that change, two screens, kills."""

from __future__ import annotations

import json
import secrets
import signal
import socket
import subprocess
import sys
import threading
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from http.client import HTTPConnection, HTTPException
from pathlib import Path
from urllib.error import URLError

import numpy as np
import pytest

Images = pytest.importorskip("PIL.Image")
pytest.importorskip("cv2")

from cli.command_line import orip  # noqa: E402  # after what it needs
from screen.rendered_project import NEW, Rendered, asked, make_project, served  # noqa: E402


@pytest.fixture(scope="module")
def rendered() -> Rendered:
    return Rendered()


@pytest.fixture
def project(tmp_path: Path, rendered: Rendered) -> Path:
    return make_project(tmp_path, rendered)


@contextmanager
def screen_of(folder: Path) -> Iterator[tuple[subprocess.Popen, str]]:
    """Run `orip screen` in a process of its own; give it and the address of its page."""
    command = [sys.executable, "-m", "orip", "-C", str(folder), "screen", "--no-open"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    try:
        assert process.stdout is not None
        yield process, process.stdout.readline().strip()
    finally:
        process.kill()
        process.communicate()


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


@pytest.mark.parametrize("count", [2000, pytest.param(100_000, marks=pytest.mark.long)])
def test_a_guessed_token_is_refused_each_time(project: Path, count: int) -> None:
    with served(project) as server:
        assert guess(server, count) == {403: count}
        assert asked(server.url, "scene")[0] == 200
    assert not (project / "EDITS.MEA").exists()


@pytest.mark.parametrize("count", [1000, pytest.param(10_000, marks=pytest.mark.long)])
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


def test_a_second_screen_is_refused_with_what_to_do(project: Path) -> None:
    with screen_of(project) as (process, url):
        assert asked(url, "scene")[0] == 200
        for more in ((), ("--stereo",)):
            said = orip(project, "screen", "--no-open", *more)
            assert said.code != 0
            if not more:
                assert "on another screen: measure on that page, or end the 'orip screen'" in said.err
        process.send_signal(signal.SIGINT)
        assert process.wait(20) == 0
    with screen_of(project) as (_, url):
        assert asked(url, "scene")[0] == 200


@pytest.mark.timeout(1800)
@pytest.mark.parametrize("kills", [3, pytest.param(50, marks=pytest.mark.long)])
def test_what_was_acknowledged_stays_whenever_the_screen_is_killed(
    project: Path, rendered: Rendered, kills: int
) -> None:
    """Killed at random moments between and during measurements: the log is whole, and has what was answered."""
    x, y = rendered.pixel(0, NEW["C7"])
    random, acknowledged, wanted = np.random.default_rng(12), [], []
    for kill in range(kills):
        with screen_of(project) as (process, url):
            timer = threading.Timer(float(random.uniform(0.0, 0.5)), process.kill)
            timer.start()
            with suppress(OSError, HTTPException, URLError):
                for number in range(10_000):
                    name = f"K{kill}-{number}"
                    wanted.append(name)
                    status, said = asked(url, "measure", {"photo": "P0", "point": name, "x": x, "y": y})
                    assert status == 200
                    assert "error" not in said
                    acknowledged.append(name)
            timer.join()
        path = project / "EDITS.MEA"
        if path.exists():
            written = [line.split()[0] for line in path.read_text().splitlines() if line.startswith("  K")]
            assert set(acknowledged) <= set(written) <= set(wanted)
    assert len(acknowledged) > kills
    said = orip(project, "measure")  # all of the log can be read
    assert said.code == 0, said.err
