"""Sessions of `orip online` that answer at once, and go on reconsidering after the answer."""

from __future__ import annotations

import _thread
import gc
import json
import random
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from support.json_schemas import schema_faults
from support.sample_projects import sample
from threadpoolctl import threadpool_limits
from workflow.online_points import typed_points
from workflow.small_projects import first_project, without_points

from orip.online.block.online_block import OnlineBlock
from orip.online.measuring import Measuring
from orip.online.page import ServedSession
from orip.online.requests import Background
from orip.online.session import OnlineSession
from orip.online.simulation import simulated_session
from orip.workflow.project.commit import commit
from orip.workflow.project.state import read_project
from orip.workflow.records.initialise import initialise

SHOWN = ("photos", "points", "cameras", "statistics", "residuals", "waiting", "suspects")


@pytest.fixture(autouse=True)
def one_thread() -> Iterator[None]:
    with threadpool_limits(1, user_api="blas"):
        yield


def _begun(folder: Path, seconds: float | None) -> tuple[OnlineSession, ServedSession]:
    session = OnlineSession(folder, None, seconds)
    return session, ServedSession(session, folder)


def _said(served: ServedSession, request: dict[str, Any]) -> dict[str, Any]:
    reply = served.reply(json.dumps(request))
    assert reply is not None
    return reply


def _requests(points: list[tuple[str, str, float, float]]) -> Iterator[dict[str, Any]]:
    """Yield requests of all kinds that change a session."""
    for photo, point, x, y in points:
        yield {"do": "measure", "photo": photo, "point": point, "x": x, "y": y}
    photo, point, x, y = points[-1]
    name = {"photo": photo, "point": point}
    yield {"do": "measure", **name, "x": x + 400.0, "y": y + 400.0}
    yield {"do": "undo"}
    yield {"do": "exclude", **name}
    yield {"do": "include", **name}
    yield {"do": "remove", **name}
    yield {"do": "undo"}


@pytest.mark.parametrize(
    "name",
    [None, pytest.param("zurich_city_hall", marks=[pytest.mark.long, pytest.mark.timeout(600)])],
)
def test_where_a_session_ends_does_not_depend_on_how_fast_it_was_asked(tmp_path: Path, name: str | None) -> None:
    """Typed without a pause, and with one after each request in which all that follows from it is reconsidered."""
    ends, pending = [], []
    for seconds in (0.0, None):
        if name is None:
            folder = first_project(tmp_path / str(seconds))
            points = without_points(folder)
            commit(initialise(read_project(folder, "definitions")))
        else:
            folder = sample(tmp_path / str(seconds), name)
            commit(initialise(read_project(folder, "definitions")))
            points = typed_points(folder)
        random.Random(5).shuffle(points)
        session, served = _begun(folder, seconds)
        replies = []
        for request in _requests(points):
            replies.append(_said(served, request))
            if seconds is None:
                assert session.measuring, "waited for"
        assert not any("error" in reply for reply in replies)
        pending.append(sum(bool(reply.get("pending")) for reply in replies))
        ends.append([_said(served, {"do": "show", "what": what}) for what in SHOWN])
    assert pending[0] > pending[1]
    assert ends[0] == ends[1]


def test_what_was_not_waited_for_is_told_later(tmp_path: Path) -> None:
    folder = first_project(tmp_path / "first")
    points = without_points(folder)
    commit(initialise(read_project(folder, "definitions")))
    _, served = _begun(folder, 0.0)
    woken = threading.Event()
    served.on_news(woken.set)
    requests = [{"do": "measure", "photo": photo, "point": point, "x": x, "y": y} for photo, point, x, y in points]
    replies = [_said(served, request) for request in requests]
    # these may have been quicker than nothing at all
    late = [(reply["photo"], reply["point"]) for reply in replies if reply["pending"]]
    documents = list(served.ended())
    assert late
    assert woken.is_set()
    assert [fault for document in documents for fault in schema_faults(document)] == []
    told = [document["reconsidered"] for document in documents]
    assert set(late) <= {(answer["photo"], answer["point"]) for answer in told}
    assert not any(answer["pending"] for answer in told)
    assert told[-1]["state"] in ("included", "unchecked")
    assert {photo for answer in told for photo in answer["oriented"]} == {"left", "right"}
    assert not list(served.ended())


def test_an_answer_does_not_wait_for_what_was_asked_before(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whatever the first request takes, the second one is kept and answered; it is carried out after that."""
    folder = first_project(tmp_path / "first")
    points = without_points(folder)
    commit(initialise(read_project(folder, "definitions")))
    session, served = _begun(folder, 0.01)
    goes_on = threading.Event()
    reconsider = Measuring.reconsider
    monkeypatch.setattr(Measuring, "reconsider", lambda measuring: goes_on.wait(60.0) and reconsider(measuring))
    for photo, point, x, y in points[:2]:
        reply = _said(served, {"do": "measure", "photo": photo, "point": point, "x": x, "y": y})
        assert reply["pending"]
        assert f"{point} {x:.4f} {y:.4f}" in " ".join((folder / "EDITS.MEA").read_text().split())
    assert served.page.state()["answer"] == reply
    photo, point, _, _ = points[1]
    assert _said(served, {"do": "remove", "photo": photo, "point": point})["state"] == "removed"
    assert "is not measured" in _said(served, {"do": "remove", "photo": photo, "point": point})["error"]
    goes_on.set()
    assert len(session.measuring.block.measurements) == 1


def test_a_session_without_a_thread_ends_with_an_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """`Thread.start` would wait for ever where a new thread lacks the memory for its first step."""
    folder = first_project(tmp_path)
    photo, point, x, y = without_points(folder)[0]
    commit(initialise(read_project(folder, "definitions")))
    _, served = _begun(folder, None)
    monkeypatch.setattr(_thread, "start_new_thread", lambda *_: 0)
    monkeypatch.setattr("orip.threads.BEGINS_WITHIN_S", 0.05)
    with pytest.raises(MemoryError, match="no thread for the session"):
        _said(served, {"do": "measure", "photo": photo, "point": point, "x": x, "y": y})


def test_a_session_that_is_over_leaves_no_thread(monkeypatch: pytest.MonkeyPatch) -> None:
    """One begins again with every change of a control file."""
    ended, start = threading.Event(), _thread.start_new_thread

    def started(task: Callable[[], None], arguments: tuple[()]) -> int:
        def whole() -> None:
            task()
            ended.set()

        return start(whole, arguments)

    monkeypatch.setattr(_thread, "start_new_thread", started)
    background = Background(Measuring(OnlineBlock(simulated_session(2, 2, 0).inputs)), None)
    assert background.ask(lambda _: None) is None
    assert background.measuring() is not None
    assert not ended.is_set()
    del background
    gc.collect()
    assert ended.wait(20.0)
