"""What a session advises to add is what `orip plan place` finds in the same block, adjusted anew."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest
from cli.command_line import orip
from support.long_cases import every
from workflow.small_projects import REPOSITORY, first_project

from orip.online.replies import reply_to
from orip.online.session import OnlineSession


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    made = tmp_path_factory.mktemp("online") / "drone"
    shutil.copytree(REPOSITORY / "sample_projects" / "drone_rtk", made)
    assert orip(made, "init").code == orip(made, "measure").code == 0
    return made


@pytest.fixture(scope="module")
def session(folder: Path) -> OnlineSession:
    return OnlineSession(folder, None)


def asked(session: OnlineSession, folder: Path, **request: object) -> dict:
    reply = reply_to(session, folder, json.dumps({"do": "add", **request}))
    assert reply is not None
    return reply


@pytest.mark.parametrize(("what", "number"), every(3, [("control", 2), ("distances", 1), ("photos", 1)]))
def test_a_session_advises_what_the_command_finds(folder, session, what, number):
    found = asked(session, folder, what=what, number=number)
    command = ("plan", "place", str(number), "--what", what, "--adjusted", "--places", "100", "--json")
    expected = orip(folder, *command).document
    assert {key: found[key] for key in ("what", "goal", "points", "distances")} == {
        key: expected[key] for key in ("what", "goal", "points", "distances")
    }
    assert len(found["points"] + found["distances"] + found["photos"]) == number
    assert found["value"] == pytest.approx(expected["value"], rel=1e-9)
    assert found["curve"] == pytest.approx(expected["curve"], rel=1e-9)
    assert found["value"] < found["curve"][0]


def test_nothing_is_written(folder, session):
    before = {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()}
    asked(session, folder, what="control")
    assert {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()} == before


@pytest.mark.parametrize(
    ("request_", "said"),
    [
        ({"what": "check"}, "control, distances, photos"),
        ({}, "missing"),
        ({"what": "photos", "number": 0}, "from 1 to 20"),
        ({"what": "photos", "number": True}, "from 1 to 20"),
        ({"what": "photos", "many": 3}, "does not have"),
    ],
)
def test_requests_that_are_none_say_what_is_allowed(folder, session, request_, said):
    assert said in asked(session, folder, **request_)["error"]


def test_a_session_without_measurements_says_so(tmp_path):
    made = first_project(tmp_path / "p")
    for file in made.glob("*.MEA"):
        file.unlink()
    assert orip(made, "init").code == 0
    assert "nothing is measured" in asked(OnlineSession(made, None), made, what="photos")["error"]
