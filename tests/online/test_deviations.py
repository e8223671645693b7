"""Standard deviations in a session are those of `orip solve`, and what coordinates refer to is said."""

from __future__ import annotations

import json
import re
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import pytest
from cli.command_line import orip
from support.online_answers import last_answer
from workflow.small_projects import first_project, replace_in

from orip.online.block.online_block import OnlineBlock
from orip.online.measuring import Measuring
from orip.online.replies import reply_to
from orip.online.replies import shown as in_session
from orip.online.requests import Request
from orip.online.session import OnlineSession
from orip.online.simulation import simulated_session
from orip.records.photo import PHOTO_PARAMETERS

LINEARISED = 1e-5
"""Relative: the solution of a session is near that of the iterations, not at it."""


def shown(folder: Path, what: str) -> dict:
    reply = reply_to(OnlineSession(folder, None), folder, json.dumps({"do": "show", "what": what}))
    assert reply is not None
    assert "error" not in reply
    return reply


@pytest.mark.parametrize(
    "held",
    [
        "",
        'constant = ["Z0"]',
        'constant = ["Z0", "KAPPA"]',  # its rotation is three angles then
    ],
)
def test_standard_deviations_are_those_of_the_adjustment(tmp_path: Path, held: str) -> None:
    folder = first_project(tmp_path / "first")
    if held:
        assert orip(folder, "run", "--no-report").code == 0
        left = json.loads((folder / "result.json").read_text(encoding="utf-8"))["photos"]["left"]
        text = (folder / "orip.toml").read_text(encoding="utf-8")
        for key in PHOTO_PARAMETERS:
            text = re.sub(rf"^{key} = .*$", f"{key} = {left[key]['value']}", text, count=1, flags=re.MULTILINE)
        (folder / "orip.toml").write_text(text, encoding="utf-8")
        replace_in(folder / "orip.toml", 'name = "left"', f'name = "left"\n{held}')
    said = orip(folder, "run", "--no-report")
    assert said.code == 0, said.err
    result = json.loads((folder / "result.json").read_text(encoding="utf-8"))
    for what, name in (("photos", "photo"), ("points", "point")):
        reply = shown(folder, what)
        assert reply["system"] == "ground"
        assert len(reply[what]) == len(result[what])
        for one in reply[what]:
            sd = one["sd"]
            adjusted = {key: value["sd"] for key, value in result[what][one[name]].items() if key in sd}
            assert [key for key in adjusted if adjusted[key] is None] == [
                key for key in one["sd"] if one["sd"][key] is None
            ]
            known = {key: value for key, value in adjusted.items() if value is not None}
            assert {key: sd[key] for key in known} == pytest.approx(known, rel=LINEARISED)
    (left,) = [one for one in shown(folder, "photos")["photos"] if one["photo"] == "left"]
    assert [key for key, value in left["sd"].items() if value is None] == [
        key for key in ("Z0", "KAPPA") if key in held
    ]


def test_a_session_without_control_is_in_a_local_system() -> None:
    session = simulated_session(2, 3, 0)
    measuring = Measuring(OnlineBlock(session.inputs))
    control = {point.name for point in session.inputs.control.points}
    for one in session.measurements:
        if one[1] not in control:
            last_answer(measuring, one)
    of_session = cast(OnlineSession, SimpleNamespace(measuring=measuring))
    for what in ("photos", "points", "summary"):
        reply = in_session(of_session, Request("show", what=what))
        assert reply["system"] == "local"
        # scale and datum are chosen
        assert not any("sd" in one for one in reply[what] if what != "summary")
    for one in session.measurements:
        if one[1] in control:
            last_answer(measuring, one)
    reply = in_session(of_session, Request("show", what="photos"))
    assert reply["system"] == "ground"
    assert all(one["sd"]["X0"] > 0.0 for one in reply["photos"])
