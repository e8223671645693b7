"""The page on a plate processor at the other end of a link: it looks on, and operates when nobody else does."""

from __future__ import annotations

import hashlib
import time

import numpy as np
import pytest
from link.served import OTHER_TABLE, TABLE, Raw, served
from support.drive_tables import loaded, vertical_block

from orip.errors import LinkError
from orip.multimodel.link import watch_processor
from orip.multimodel.link.watch import FRESH_S, Watch
from orip.multimodel.link.watch_processor import LinkedProcessor
from orip.multimodel.plan_view import BlockPoints, plan_view

DIGEST = hashlib.sha256(TABLE).hexdigest()


def watch_of(port):
    block, _ = loaded(vertical_block())
    ground = BlockPoints(("1", "2"), ("tie", "tie"), np.array([(0.0, 0.0, 0.0), (60.0, -40.0, 0.0)]))
    return Watch(block, plan_view(block, ground), LinkedProcessor(f"tcp://127.0.0.1:{port}", DIGEST))


@pytest.fixture
def port():
    with served() as found:
        yield found


@pytest.fixture
def watch(port):
    found = watch_of(port)
    yield found
    found.close()


def state_of(watch):
    time.sleep(2.0 * FRESH_S)
    return watch.state()


def test_it_shows_what_others_drive(port, watch):
    first = watch.state()
    assert (first["model"], first["condition"], first["guide"]) == ("M1-1", "IN", "OBJECT")
    with Raw(port) as operator:
        assert "OBSERVER" not in operator.greeting  # the page has left the role to who wants it
        operator.ask("DRIVE OBJECT 45 -3 1")
        found = state_of(watch)
    assert found["model"] == "M1-3"
    # plates are read to a micrometre, at 1:2000
    assert found["mark"] == pytest.approx([45.0, -3.0, 1.0], abs=0.02)
    assert found["serial"] == first["serial"] + 1


def test_it_drives_and_gives_the_role_back(port, watch):
    reply = watch.drive({"plan": [25.0, 3.0]})
    assert (reply["refused"], reply["state"]["model"]) == (None, "M1-2")
    assert watch.next_model({})["state"]["model"] == "M1-3"
    assert watch.automatic({"on": False})["state"]["automatic"] is False
    refused = watch.drive({"object": [25.0, 3.0, 500.0]})["refused"]
    assert refused["code"] == 310
    with Raw(port) as operator:
        assert "OBSERVER" not in operator.greeting
        assert operator.ask("MODEL?") == "OK M1-3"


def test_it_presses_what_a_host_hears(port, watch):
    """The host digitises, the page is the panel."""
    with Raw(port) as host:
        assert host.ask("HOST") == "OK HOST"
        for request in ({"foot": "RIGHT"}, {"key": "7"}, {"key": "ENTER"}):
            assert watch.press(request)["refused"] is None
        assert host.ask("EVENT") == "OK RIGHT UPPER 34.9950 59.8950 LOWER 25.0050 60.1050"
        assert [host.ask("EVENT"), host.ask("EVENT"), host.ask("EVENT")] == ["OK KEY 7", "OK KEY ENTER", "OK NONE"]
        assert watch.next_model({})["refused"]["code"] == 110


def test_it_does_not_drive_while_somebody_operates(port, watch):
    with Raw(port) as operator:
        assert operator.ask("DRIVE OBJECT 25 3 0").startswith("OK MODEL M1-2 ")
        reply = watch.drive({"plan": [45.0, 3.0]})
        assert reply["refused"]["code"] == 110
        assert reply["state"]["model"] == "M1-2"


def test_another_table_is_not_shown_in_place_of_this_one(port, watch, monkeypatch):
    monkeypatch.setattr(watch_processor, "PAUSE_S", 0.0)
    with Raw(port) as operator:
        for table, lost in ((OTHER_TABLE, True), (TABLE, False)):
            operator.send(b"DOWNLOAD %d\n" % table.count(b"\n") + table)
            assert operator.read().startswith("OK LOADED")
            found = state_of(watch)
            assert ("lost" in found) == lost
        operator.send(b"DOWNLOAD %d\n" % OTHER_TABLE.count(b"\n") + OTHER_TABLE)
        assert operator.read().startswith("OK LOADED")
    with pytest.raises(LinkError, match=r"another drive table; 'orip drive download'"):
        watch_of(port)


def test_a_plate_processor_that_ends_is_lost_and_found_again(monkeypatch):
    monkeypatch.setattr(watch_processor, "PAUSE_S", 0.0)
    with served() as port:
        watch = watch_of(port)
        assert "lost" not in watch.state()
    assert "lost" in state_of(watch)
    assert "no plate processor answers" in state_of(watch)["lost"]
    refused = watch.drive({"plan": [25.0, 3.0]})["refused"]
    assert refused["code"] is None
    watch.close()
