"""The page on the plate processor: what it is told, what it may ask, and who may ask it."""

from __future__ import annotations

import http.client
import json
import socket
import threading
import time
from contextlib import contextmanager

import numpy as np
import pytest
from support.drive_tables import loaded, vertical_block

from orip.errors import LinkError
from orip.multimodel.link.client import ProcessorFault
from orip.multimodel.link.watch import Watch
from orip.multimodel.link.watch_processor import OwnProcessor
from orip.multimodel.plan_view import BlockPoints, plan_view
from orip.web.page_server import MOST_CONNECTIONS, MOST_STREAMS, WatchServer

POINTS = np.array([(x, y, 0.0) for x in range(-20, 101, 5) for y in range(-80, 41, 5)], dtype=float)


def watch_of(processor=None):
    block, state = loaded(vertical_block())
    names = tuple(map(str, range(len(POINTS))))
    plan = plan_view(block, BlockPoints(names, ("tie",) * len(POINTS), POINTS))
    return Watch(block, plan, processor or OwnProcessor((block, state)))


@contextmanager
def served(watch):
    with WatchServer(watch) as server:
        thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.01})
        thread.start()
        try:
            yield server
        finally:
            server.shutdown()
            thread.join()


@pytest.fixture(scope="module")
def server():
    with served(watch_of()) as found:
        yield found


def ask(server, method, path, body=None, *, host=None, **headers):
    """Return status, headers and body of a request."""
    connection = http.client.HTTPConnection("127.0.0.1", server.port, timeout=10)
    try:
        connection.putrequest(method, path, skip_host=True)
        connection.putheader("Host", host or f"127.0.0.1:{server.port}")
        if body is not None:
            connection.putheader("Content-Length", str(len(body)))
        for name, value in headers.items():
            connection.putheader(name.replace("_", "-"), value)
        connection.endheaders(body)
        reply = connection.getresponse()
        return reply.status, reply.headers, reply.read()
    finally:
        connection.close()


def command(server, name, request, **headers):
    body = request if isinstance(request, bytes) else json.dumps(request).encode()
    status, _, reply = ask(server, "POST", f"/{server.token}/{name}", body, Content_Type="application/json", **headers)
    return status, json.loads(reply)


def events(server):
    """Yield the states that the stream sends."""
    with socket.create_connection(("127.0.0.1", server.port), 10) as connection:
        request = f"GET /{server.token}/events HTTP/1.1\r\nHost: 127.0.0.1:{server.port}\r\n\r\n"
        connection.sendall(request.encode())
        with connection.makefile("rb") as stream:
            assert b" 200 " in stream.readline()
            for line in stream:
                if line.startswith(b"data: "):
                    yield json.loads(line[6:])


def test_the_page_comes_alone(server):
    status, headers, page = ask(server, "GET", f"/{server.token}/")
    assert (status, headers["Content-Type"]) == (200, "text/html; charset=utf-8")
    assert page.startswith(b"<!DOCTYPE html>")
    assert "default-src 'none'" in headers["Content-Security-Policy"]
    assert headers["Referrer-Policy"] == "no-referrer"
    # nothing from elsewhere: the only address is the name space of SVG
    assert page.replace(b"http://www.w3.org/2000/svg", b"").count(b"//www") == 0
    assert b"https:" not in page


def test_the_scene(server):
    scene = json.loads(ask(server, "GET", f"/{server.token}/scene")[2])
    assert (scene["block"], scene["object_unit"], scene["plate_unit"]) == ("MAIN", "m", "mm")
    assert (scene["project"], scene["user"]) == ("Any project", "A. Nyone")
    assert scene["axes"] == ["X", "Y", "Z"]
    plan = scene["plan"]
    assert (plan["right"], plan["up"], plan["third"], plan["mirrored"]) == (0, 1, 2, False)
    assert len(plan["points"]) == len(POINTS)
    assert plan["points"][0] == ["0", "tie", -20.0, -80.0]
    assert [model["name"] for model in scene["models"]][:2] == ["M1-1", "M1-2"]
    assert scene["models"][1]["photos"] == ["P1-2", "P1-3"]
    assert scene["models"][1]["swapped"] is True
    upper = scene["plates"]["UPPER"]
    assert (upper["limits"], upper["decimals"]) == ([0.0, 240.0, 0.0, 240.0], 3)
    assert [photo["name"] for photo in upper["photos"]] == ["P1-1", "P1-3", "P1-5", "P2-1", "P2-3", "P2-5"]
    # corner (-10, -12) of the frame by the interior orientation of the first photo
    x, y = 30.0 - 10.0 * 0.999 - 12.0 * 0.02, 60.0 + 10.0 * 0.021 - 12.0 * 1.001
    assert upper["photos"][0]["frame"][0] == pytest.approx([x, y], abs=1e-9)


def test_driving_across_a_frame_line_changes_the_model(server):
    # models of this block border on each other at X = 20, 40, 60; the ground is at Z = 0
    status, reply = command(server, "drive", {"plan": [15.0, 3.0]})
    assert (status, reply["refused"]) == (200, None)
    assert (reply["state"]["model"], reply["state"]["condition"]) == ("M1-1", "IN")
    assert reply["state"]["mark"] == pytest.approx([15.0, 3.0, 0.0], abs=1e-9)
    state = command(server, "drive", {"plan": [25.0, 3.0]})[1]["state"]
    assert state["model"] == "M1-2"
    state = command(server, "drive", {"object": [25.0, -47.0, 4.0]})[1]["state"]
    assert state["model"] == "M2-2"
    assert state["mark"] == pytest.approx([25.0, -47.0, 4.0], abs=1e-9)


def test_next_model_and_automatic_switching(server):
    command(server, "drive", {"plan": [15.0, 3.0]})
    assert command(server, "automatic", {"on": False})[1]["state"]["automatic"] is False
    assert command(server, "next", {})[1]["state"]["model"] == "M1-2"
    state = command(server, "drive", {"plan": [15.0, 3.0]})[1]["state"]
    assert (state["model"], state["condition"]) == ("M1-2", "OUTSIDE")
    assert command(server, "automatic", {"on": True})[1]["state"]["automatic"] is True


def test_a_refusal_is_an_answer_and_moves_nothing(server):
    before = command(server, "drive", {"plan": [15.0, 3.0]})[1]["state"]
    status, reply = command(server, "drive", {"object": [15.0, 3.0, 500.0]})
    assert status == 200
    assert reply["refused"] == {"code": 310, "text": "the point is not in front of photo P1-1"}
    assert reply["state"] == before


@pytest.mark.parametrize(
    ("name", "request_", "text"),
    [
        ("drive", {}, "drive takes"),
        ("drive", {"plan": [1.0, 2.0], "object": [1.0, 2.0, 3.0]}, "drive takes"),
        ("drive", {"plan": [1.0]}, "2 finite numbers"),
        ("drive", {"plan": "ab"}, "2 finite numbers"),
        ("drive", {"plan": [True, 1.0]}, "2 finite numbers"),
        ("drive", {"object": [1.0, 2.0, None]}, "3 finite numbers"),
        ("drive", b'{"plan": [NaN, Infinity]}', "2 finite numbers"),
        ("drive", b'{"plan": [1' + b"0" * 400 + b", 1]}", "2 finite numbers"),
        ("drive", b"{", "one JSON object"),
        ("drive", b"[" * 4000, "one JSON object"),
        ("drive", b"\xff", "one JSON object"),
        ("drive", [1, 2], "one JSON object"),
        ("automatic", {"on": 1}, "true or false"),
        ("next", {"on": 1}, "takes nothing"),
        ("press", {}, "press takes"),
        ("press", {"foot": "BOTH"}, "press takes"),
        ("press", {"foot": ["LEFT"]}, "press takes"),
        ("press", {"key": 1}, "press takes"),
        ("press", {"key": "16"}, "press takes"),
        ("press", {"key": "1", "foot": "LEFT"}, "press takes"),
    ],
)
def test_what_cannot_be_understood_is_told(server, name, request_, text):
    status, reply = command(server, name, request_)
    assert status == 400
    assert text in reply["error"]


def test_only_this_machine_with_the_token_is_served(server):
    page, body = f"/{server.token}/", b'{"plan": [25.0, 3.0]}'
    before = json.loads(command_reply(server, {"plan": [15.0, 3.0]}))["state"]
    json_type = {"Content_Type": "application/json"}
    tries = {
        "no token": (403, ("GET", "/"), {}),
        "wrong token": (403, ("GET", f"/{server.token[:-1]}!/"), {}),
        "token without a slash": (403, ("GET", page[:-1]), {}),
        "another name of this machine": (403, ("GET", page), {"host": f"evil.example:{server.port}"}),
        "another port": (403, ("GET", page), {"host": "127.0.0.1:1"}),
        "another page": (403, ("POST", page + "drive", body), {"Origin": "http://evil.example", **json_type}),
        "a page without an origin": (403, ("POST", page + "drive", body), {"Origin": "null", **json_type}),
        "a form": (415, ("POST", page + "drive", body), {"Content_Type": "text/plain"}),
        "a command of another name": (404, ("POST", page + "forward", b"{}"), json_type),
        "a file": (404, ("GET", page + "../watch.html"), {}),
        "too long": (413, ("POST", page + "drive", b" " * 5000), json_type),
        "no length": (411, ("POST", page + "drive"), json_type),
        "another method": (501, ("PUT", page), {}),
    }
    for what, (expected, request, headers) in tries.items():
        status, found, reply = ask(server, *request, **headers)
        assert status == expected, what
        assert found["Content-Type"] == "application/json", what
        assert set(json.loads(reply)) == {"error"}, what
    assert server.watch.state() == before
    assert ask(server, "GET", page, host=f"localhost:{server.port}")[0] == 200
    same = f"http://127.0.0.1:{server.port}"
    assert ask(server, "POST", page + "drive", body, Origin=same, **json_type)[0] == 200


def command_reply(server, request):
    return ask(server, "POST", f"/{server.token}/drive", json.dumps(request).encode(), Content_Type="application/json")[
        2
    ]


def test_many_pages_see_the_same(server):
    command(server, "drive", {"plan": [15.0, 3.0]})
    streams = [events(server) for _ in range(12)]
    first = [next(stream) for stream in streams]
    assert all(state == first[0] for state in first)
    moved = command(server, "drive", {"plan": [35.0, -3.0]})[1]["state"]
    assert moved["serial"] > first[0]["serial"]
    assert [next(stream) for stream in streams] == [moved] * 12
    for stream in streams:
        stream.close()


def test_pages_drive_at_the_same_time(server):
    """Commands of eight pages are done one after the other; each reply is of a state that was."""

    def drive(page, replies):
        for step in range(20):
            replies.append(command(server, "drive", {"plan": [5.0 + page, float(step)]})[1]["state"])

    replies = []
    threads = [threading.Thread(target=drive, args=(page, replies)) for page in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len({reply["serial"] for reply in replies}) == len(replies) == 160
    assert {tuple(np.round(reply["mark"][:2], 6)) for reply in replies} == {
        (5.0 + page, float(step)) for page in range(8) for step in range(20)
    }


def test_more_pages_than_there_are_streams():
    with served(watch_of()) as server:
        for _ in range(MOST_STREAMS):
            assert server.streams.acquire(blocking=False)
        status, _, reply = ask(server, "GET", f"/{server.token}/events")
        assert status == 503
        assert "pages are open" in json.loads(reply)["error"]


def test_the_server_ends_with_streams_and_silent_connections_open():
    before = threading.active_count()
    with served(watch_of()) as server:
        stream = events(server)
        next(stream)
        silent = socket.create_connection(("127.0.0.1", server.port))
    assert list(stream) == []  # the end of the stream, not a time-out
    silent.close()
    deadline = time.monotonic() + 5.0
    while threading.active_count() > before and time.monotonic() < deadline:
        time.sleep(0.01)
    assert threading.active_count() == before
    with pytest.raises(ConnectionRefusedError):
        ask(server, "GET", "/")


class Broken:
    """A plate processor whose link breaks off, and comes back."""

    def __init__(self):
        self.own, self.fault = OwnProcessor(loaded(vertical_block())), None

    def read(self):
        return self._asked(self.own.read)

    def drive_object(self, xyz):
        return self._asked(lambda: self.own.drive_object(xyz))

    def _asked(self, request):
        if self.fault is not None:
            raise self.fault
        return request()


def test_a_link_that_breaks_off_is_shown():
    broken = Broken()
    watch = watch_of(broken)
    first = watch.state()
    assert first["serial"] == 1
    broken.fault = LinkError("the connection broke off")
    reply = watch.drive({"plan": [25.0, 3.0]})
    assert reply["refused"] == {"code": None, "text": "the connection broke off"}
    assert reply["state"] == {"serial": 2, "lost": "the connection broke off"}
    broken.fault = ProcessorFault(110, "operated from 127.0.0.1:5000")
    assert watch.drive({"plan": [25.0, 3.0]})["refused"] == {"code": 110, "text": "operated from 127.0.0.1:5000"}
    broken.fault = None
    time.sleep(0.05)
    assert {**watch.state(), "serial": 1} == first


def test_more_connections_than_can_be_served_are_ended_and_those_that_end_make_room():
    with served(watch_of()) as server:
        held = [socket.create_connection(("127.0.0.1", server.port), 10) for _ in range(MOST_CONNECTIONS + 5)]
        held[-1].settimeout(10)
        assert held[-1].recv(1) == b""
        for one in held:
            one.close()
        deadline = time.monotonic() + 10
        while True:
            try:
                assert ask(server, "GET", f"/{server.token}/scene")[0] == 200
            except (OSError, http.client.HTTPException):  # those that were left are not all ended yet
                assert time.monotonic() < deadline
                time.sleep(0.05)
            else:
                break
