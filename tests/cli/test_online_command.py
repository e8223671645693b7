"""`orip online` as a program: lines in, lines out; and the simulated session."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from cli.command_line import orip
from scipy.stats import poisson
from workflow.small_projects import first_project, without_points

PROGRAM = [sys.executable, "-m", "orip"]
ENVIRONMENT = {**os.environ, "OPENBLAS_NUM_THREADS": "1"}


def test_each_line_is_answered_by_a_line(tmp_path: Path) -> None:
    folder = first_project(tmp_path / "first")
    subprocess.run([*PROGRAM, "-C", folder, "init", "-q"], check=True, env=ENVIRONMENT)
    requests = '{"do": "show", "what": "photos"}\nthis is none\n\n{"do": "quit"}\n{"do": "show"}\n'
    done = subprocess.run(
        [*PROGRAM, "-C", folder, "online"], input=requests, capture_output=True, text=True, check=True, env=ENVIRONMENT
    )
    summary, photos, fault = map(json.loads, done.stdout.splitlines())
    assert "2 photos oriented" in summary["summary"]
    assert [photo["photo"] for photo in photos["photos"]] == ["left", "right"]
    assert "not a request" in fault["error"]


@pytest.mark.long
def test_demonstration_names_the_three_blunders() -> None:
    """A block of 24 photos; sessions of six photos are tested with each run."""
    done = subprocess.run(
        [*PROGRAM, "--json", "online", "--demo"], capture_output=True, text=True, check=True, env=ENVIRONMENT
    )
    found = json.loads(done.stdout)
    wrong = [line.split(" by ")[0].strip() for line in done.stderr.splitlines() if " by (" in line]
    assert len(wrong) == 3
    # of 468 measurements each fails its test wrongly with a probability of 0.001
    assert set(wrong) <= set(found["suspects"])
    assert len(found["suspects"]) <= len(wrong) + poisson.ppf(0.999, 0.468)
    assert "450 unknowns" in done.stderr


def test_the_demonstration_serves_nobody(tmp_path: Path) -> None:
    said = orip(tmp_path, "online", "--demo", "--listen", "127.0.0.1:0", "--page")
    assert said.code == 2
    assert "leave --listen, --page out" in said.err


def test_a_killed_session_has_every_measurement_that_it_has_answered(tmp_path: Path) -> None:
    folder = first_project(tmp_path / "first")
    subprocess.run([*PROGRAM, "-C", folder, "init", "-q"], check=True, env=ENVIRONMENT)
    asked = {"do": "measure", "photo": "left", "point": "K9", "x": 1500.25, "y": 1600.5}
    with subprocess.Popen(
        [*PROGRAM, "-C", folder, "online"], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=ENVIRONMENT
    ) as session:
        assert session.stdin is not None
        assert session.stdout is not None
        session.stdout.readline()
        session.stdin.write(json.dumps(asked) + "\n")
        session.stdin.flush()
        answer = json.loads(session.stdout.readline())
        session.kill()
    assert "error" not in answer
    again = subprocess.run(
        [*PROGRAM, "-C", folder, "online"], input='{"do": "show", "what": "waiting"}\n', capture_output=True, text=True,
        check=True, env=ENVIRONMENT,
    )  # fmt: skip
    assert "K9 1500.2500 1600.5000" in " ".join((folder / "EDITS.MEA").read_text().split())
    assert "11 photo points measured" in again.stdout
    assert "K9" in again.stdout


@pytest.mark.long
@pytest.mark.timeout(600)
def test_sessions_killed_after_each_step_and_within_the_next_end_like_one_that_was_not(tmp_path: Path) -> None:
    """Each process is killed with a second request on its way, which may be carried out or not, but never by half."""
    folder, other = (first_project(tmp_path / name) for name in ("killed", "whole"))
    points = without_points(folder)
    without_points(other)
    for project in (folder, other):
        subprocess.run([*PROGRAM, "-C", project, "init", "-q"], check=True, env=ENVIRONMENT)
    lines = [
        json.dumps({"do": "measure", "photo": photo, "point": name, "x": x, "y": y}) + "\n"
        for photo, name, x, y in points
    ]
    for number, line in enumerate(lines):
        with subprocess.Popen(
            [*PROGRAM, "-C", folder, "online"], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
            env=ENVIRONMENT,
        ) as session:  # fmt: skip
            assert session.stdin is not None
            assert session.stdout is not None
            summary = json.loads(session.stdout.readline())["summary"]
            # what was answered, and perhaps the request after it
            assert any(f"{count} photo point" in summary for count in (number, number + 1))
            session.stdin.write(line)
            session.stdin.flush()
            assert "error" not in json.loads(session.stdout.readline())
            session.stdin.write(lines[min(number + 1, len(lines) - 1)])
            session.stdin.flush()
            time.sleep(0.003 * number)
            session.kill()
    ends = []
    for project, requests in ((folder, []), (other, lines)):
        done = subprocess.run(
            [*PROGRAM, "-C", project, "online"], input="".join([*requests, '{"do": "relinearise"}\n']),
            capture_output=True, text=True, check=True, env=ENVIRONMENT,
        )  # fmt: skip
        ends.append(json.loads(done.stdout.splitlines()[-1]))
    assert ends[0] == ends[1]
    assert "10 photo points measured, 2 photos oriented" in ends[0]["summary"]


@contextlib.contextmanager
def listening(folder: Path) -> Iterator[tuple[subprocess.Popen[str], int, str]]:
    """Serve a session to programs; yield its process, port and token."""
    words = [*PROGRAM, "-C", folder, "online", "--listen", "127.0.0.1:0"]
    with subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=ENVIRONMENT) as session:
        assert session.stdout is not None
        told = json.loads(session.stdout.readline())
        try:
            yield session, int(told["listening"].rpartition(":")[2]), told["token"]
        finally:
            session.kill()


def said_to(port: int, *sent: bytes) -> list[str]:
    """Return all that is said to a program, which sends its words in pieces."""
    with socket.create_connection(("127.0.0.1", port), 30) as connection:
        for piece in sent:
            with contextlib.suppress(ConnectionError):
                connection.sendall(piece)
            time.sleep(0.2)
        received = b""
        with contextlib.suppress(ConnectionError):
            while data := connection.recv(1 << 16):
                received += data
    return received.decode().splitlines()


MEASURED = b'{"do": "measure", "photo": "left", "point": "K9", "x": 1500.25, "y": 1600.5}\n'
SAID_BY_ANOTHER_ACCOUNT = """
import os, socket, sys
"x".encode("idna"); os.setgroups([]); os.setgid(65534); os.setuid(65534)
with socket.create_connection(("127.0.0.1", int(sys.argv[1])), 10) as connection:
    connection.sendall(sys.argv[2].encode())
    with connection.makefile() as lines:
        print(lines.read())
"""


def test_a_page_of_the_web_and_another_account_measure_nothing(adjusted: Path) -> None:
    with listening(adjusted) as (_, port, token):
        before = {path: path.read_bytes() for path in adjusted.glob("*.MEA")}
        head = b"POST / HTTP/1.1\r\nHost: 127.0.0.1\r\nOrigin: http://evil.example\r\nContent-Length: 100\r\n\r\n"
        for said in (said_to(port, head + MEASURED), said_to(port, MEASURED + MEASURED)):
            assert said[0] == '{"wants": "token"}'
            assert "is not the token" in said[1]
            assert len(said) == 2
        if os.name == "posix" and os.geteuid() == 0:
            words = [sys.executable, "-c", SAID_BY_ANOTHER_ACCOUNT, str(port), MEASURED.decode()]
            assert "is not the token" in subprocess.run(words, capture_output=True, text=True, check=True).stdout
        assert {path: path.read_bytes() for path in adjusted.glob("*.MEA")} == before
        quit_ = b'{"do": "quit"}\n'
        shown = said_to(port, json.dumps({"token": token}).encode() + b"\n", MEASURED, quit_)
        assert '"role": "writes"' in shown[1]
        assert '"error"' not in shown[2]
    assert b"K9" in (adjusted / "EDITS.MEA").read_bytes()


@pytest.mark.parametrize("length", [5000, 100_000])
def test_a_long_line_in_two_pieces_hangs_nobody_and_ctrl_c_ends_the_session(adjusted: Path, length: int) -> None:
    with listening(adjusted) as (session, port, token):
        let_in = json.dumps({"token": token}).encode() + b"\n"
        with socket.create_connection(("127.0.0.1", port), 30) as other, other.makefile() as lines:
            other.sendall(let_in)
            assert "role" in lines.readline() + lines.readline()
            said = said_to(port, let_in, b"A" * length, b"A" * length, b"\n")
            assert "a request has at most 4096 bytes; the connection ends" in said[-1]
            other.sendall(b'{"do": "show"}\n')
            assert "error" not in lines.readline()
            began = time.monotonic()
            session.send_signal(signal.SIGINT)
            assert session.wait(20) == 0
            assert time.monotonic() - began < 5.0
