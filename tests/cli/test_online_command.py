"""`orip online` as a program: lines in, lines out; and the simulated session."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
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
