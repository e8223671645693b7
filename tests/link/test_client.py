"""The host's end of the link, to the emulator and to others that are none."""

from __future__ import annotations

import hashlib
import socket
import sys
import threading
import time
from contextlib import contextmanager

import pytest
from link.served import OTHER_TABLE, TABLE, Raw, served

from orip.errors import LinkError
from orip.multimodel.link import client as client_module
from orip.multimodel.link.client import ProcessorFault, observe_link, open_link
from orip.multimodel.link.station import bare_stages
from orip.multimodel.state import Event


@pytest.fixture(autouse=True)
def no_long_pauses(monkeypatch):
    monkeypatch.setattr(client_module, "FIRST_PAUSE_S", 0.01)


@pytest.fixture
def port():
    with served() as port:
        yield port


@pytest.fixture
def link(port):
    with open_link(f"tcp://127.0.0.1:{port}") as link:
        yield link


def test_driving(link):
    assert link.greeting == ("READY", None)
    assert link.drive_object(30.0, 0.0, 0.0) == ("M1-2", (45.005, 60.105), (34.995, 59.895))
    assert link.position("OBJECT") == ((30.0, 0.0, 0.0), 0.0)
    assert link.position("MODEL") == ((10.0, 0.0, -100.0), 0.0)
    assert link.position("PLATE") == ((45.005, 60.105), (34.995, 59.895))
    assert link.position("PHOTO") == (("P1-2", "LEFT", (5.0, 0.0)), ("P1-3", "RIGHT", (-5.0, 0.0)))
    assert link.change_model("M1-1").model == "M1-1"
    assert link.next_model().model == "M1-2"
    assert link.drive_model(10.0, 0.0, -100.0).upper == (45.005, 60.105)
    assert link.drive_plate("UPPER", 12.0, 34.5).upper == (12.0, 34.5)
    assert link.drive_photo("P1-3", 0.0, 0.0).upper == (50.0, 60.0)
    assert link.position("OBJECT").y_parallax == 0.0
    assert link.which(10.0, 0.0, 0.0) == "M1-1"
    assert link.which(10.0, 900.0, 0.0) is None
    assert link.models()[0] == "M1-1 1 1 P1-1 P1-2 NORMAL"
    assert link.forward().lower == (120.0, 0.0)
    assert link.status().condition == "LIMIT"
    assert not link.is_moving()


def test_the_panel(link):
    assert link.status() == ("M1-1", "OBJECT", "IN", None, (0, 0), True)
    assert link.guide("BOTH").guide == "BOTH"
    assert link.move(-1.0, 0.5).upper == pytest.approx((33.995, 60.395), abs=1e-9)
    assert link.lock("LEFT").lock == "LEFT"
    assert link.lock(None).lock is None
    assert link.prism("RIGHT", 90).prisms == (0, 90)
    assert link.prism(None, 90).prisms == (90, 90)
    assert not link.automatic(False).automatic


def test_events(link):
    assert link.next_event() is None
    link.foot("RIGHT")
    link.key("ENTER")
    link.foot("LEFT")
    plates = ((34.995, 59.895), (25.005, 60.105))
    assert [link.next_event() for _ in range(3)] == [
        Event("RIGHT", plates=plates),
        Event("KEY", "ENTER"),
        Event("LEFT"),
    ]


def test_a_profile(link):
    points = link.profile((10.0, 0.0, 0.0), (10.0, 0.0, 200.0), 100.0)
    assert [point.xyz for point in points] == [(10.0, 0.0, z) for z in (0.0, 100.0, 200.0)]
    assert points[0].driven == ("M1-1", (34.995, 59.895), (25.005, 60.105))
    assert points[1:] == [((10.0, 0.0, 100.0), None), ((10.0, 0.0, 200.0), None)]


def test_download_is_verified(link):
    assert link.download(OTHER_TABLE) == "LOADED cameras 1 photos 3 models 2"
    assert link.digest() == hashlib.sha256(OTHER_TABLE).hexdigest()
    with pytest.raises(ProcessorFault, match="CRC-32") as refused:
        link.download(TABLE.replace(b"M1-1", b"M1-0"))
    assert refused.value.code == 121
    with pytest.raises(LinkError, match="cut short"):
        link.download(TABLE[:-1])
    assert link.digest() == hashlib.sha256(OTHER_TABLE).hexdigest()


def test_a_download_that_arrived_as_another_table(link, monkeypatch):
    monkeypatch.setattr(link, "digest", lambda: "0" * 64)
    with pytest.raises(LinkError, match="has loaded another table than was sent"):
        link.download(OTHER_TABLE)


def test_refusals_carry_their_code(link):
    with pytest.raises(ProcessorFault, match="refused, error 311: the point is outside the limits") as refused:
        link.drive_object(10.0, 0.0, 99.0)
    assert (refused.value.code, refused.value.exit_code) == (311, 7)
    with pytest.raises(ProcessorFault) as refused:
        link.drive_object(float("nan"), 0.0, 0.0)
    assert refused.value.code == 102


@pytest.mark.parametrize("line", ["NEXT\nNEXT", "MODEL Ä", "MODEL a\x00"])
def test_a_request_is_one_line(link, line):
    with pytest.raises(LinkError, match="one line of printable ASCII"):
        link.request(line)
    assert link.request("MODEL?") == "M1-1"


def test_a_second_operator_is_told_who_is_there(port, link):
    url = f"tcp://127.0.0.1:{port}"
    host, own_port = link._line._socket.getsockname()
    with pytest.raises(LinkError, match=f"is operated by {host}:{own_port}; wait, or stop that session"):
        open_link(url, retries=2)
    with observe_link(url) as observer:
        assert observer.status().model == "M1-1"
        with pytest.raises(ProcessorFault) as refused:
            observer.drive_object(30.0, 0.0, 0.0)
        assert refused.value.code == 110


def test_a_second_operator_waits_for_the_first(port, link):
    threading.Timer(0.3, link.close).start()
    with open_link(f"tcp://127.0.0.1:{port}", retries=7) as second:
        assert second.next_model().model == "M1-2"


def test_who_reads_leaves_the_role(port):
    with observe_link(f"tcp://127.0.0.1:{port}"), open_link(f"tcp://127.0.0.1:{port}", retries=0) as operator:
        assert operator.next_model().model == "M1-2"


def test_nobody_is_there():
    with socket.create_server(("127.0.0.1", 0)) as closed:
        port = closed.getsockname()[1]
    with pytest.raises(LinkError, match=f"no plate processor answers at tcp://127.0.0.1:{port} .*orip drive emulate"):
        open_link(f"tcp://127.0.0.1:{port}", retries=2)


def test_who_is_late_is_waited_for():
    with socket.create_server(("127.0.0.1", 0)) as closed:
        port = closed.getsockname()[1]
    servers = []

    def serve():
        servers.append(socket.create_server(("127.0.0.1", port)))
        with servers[0].accept()[0] as connection:
            connection.sendall(b"OK KDPP-EMU 1 EMPTY\nOK OPERATOR\n")
            connection.recv(100)

    late = threading.Timer(0.1, serve)
    late.start()
    with open_link(f"tcp://127.0.0.1:{port}", retries=7) as link:
        assert link.greeting.state == "EMPTY"
    late.join()
    servers[0].close()


@contextmanager
def impostor(*pieces, ends=False):
    """Yield the address of somebody who says something else."""
    done = threading.Event()
    with socket.create_server(("127.0.0.1", 0)) as server:

        def serve():
            with server.accept()[0] as connection:
                for piece in pieces:
                    connection.sendall(piece)
                if not ends:
                    done.wait(10.0)

        thread = threading.Thread(target=serve)
        thread.start()
        yield f"tcp://127.0.0.1:{server.getsockname()[1]}"
        done.set()
        thread.join()


@pytest.mark.parametrize(
    ("pieces", "ends", "text"),
    [
        ([b"220 mail.example.org ESMTP\r\n"], False, "is not a plate processor: it said '220 mail"),
        ([b"OK KDPP-EMU 2 READY\n"], False, "is not a plate processor: it said 'OK KDPP-EMU 2 READY'"),
        ([b"\xff\xfe\n"], False, "is not a plate processor"),
        ([b"z" * 100_000], False, "lines without end"),
        ([], False, "does not answer in time"),
        ([b"OK KDPP"], False, "does not answer in time"),
        ([], True, "has ended the connection"),
        ([b"OK KDPP-EMU 1 READY\n", b"WHAT\n"], False, "is not a plate processor: it said 'WHAT'"),
        ([b"OK KDPP-EMU 1 READY\n", b"ERR x y\n"], False, "is not a plate processor"),
        ([b"OK KDPP-EMU 1 READY\n"], True, "(has ended the connection|broke off)"),
    ],
)
def test_who_is_there_is_no_plate_processor(pieces, ends, text):
    start = time.monotonic()
    with impostor(*pieces, ends=ends) as url, pytest.raises(LinkError, match=text):
        open_link(url, timeout_s=0.3)
    assert time.monotonic() - start < 5.0


@pytest.mark.parametrize("reply", [b"OK 1 2\n", b"OK MODEL M UPPER 1 2 LOWER 3 x\n", b"OK\n"])
def test_replies_of_another_form(reply):
    pieces = [b"OK KDPP-EMU 1 READY\nOK OPERATOR\n", reply]
    with impostor(*pieces) as url, open_link(url) as link, pytest.raises(LinkError, match="cannot be read"):
        link.drive_object(1.0, 2.0, 3.0)


def test_a_list_of_another_form():
    pieces = [b"OK KDPP-EMU 1 READY\nOK OPERATOR\nOK many\n"]
    with impostor(*pieces) as url, open_link(url) as link, pytest.raises(LinkError, match="asked for a list"):
        link.models()


@pytest.mark.parametrize("url", ["tcp://", "tcp://host", "tcp://host:99999", "tcp:host:1", "tcp://a b:-1"])
def test_urls_that_are_none(url):
    with pytest.raises(LinkError, match=r"is not a link; write for example tcp://127\.0\.0\.1:4788"):
        open_link(url)


def test_a_host_that_is_not_known():
    with pytest.raises(LinkError, match=r"no plate processor answers at tcp://no-such-host\.invalid:4788"):
        open_link("tcp://no-such-host.invalid:4788", retries=0)


def test_without_pyserial(monkeypatch):
    monkeypatch.setitem(sys.modules, "serial", None)
    with pytest.raises(LinkError, match=r"needs pyserial: install it with pip install 'orip\[serial\]'"):
        open_link("/dev/ttyS0")


def test_a_serial_line(port):
    """pyserial's line over a socket: whatever is on it from before does not get out of step with what is asked."""
    pytest.importorskip("serial")
    with open_link(f"socket://127.0.0.1:{port}") as link:
        assert link.greeting == ("READY", None)
        assert link.download(OTHER_TABLE) == "LOADED cameras 1 photos 3 models 2"
        assert link.drive_object(30.0, 0.0, 0.0).model == "M1-2"
        assert len(link.profile((0.0, 0.0, 0.0), (30.0, 0.0, 0.0), 1.0)) == 31
    with Raw(port) as after:
        assert after.ask("DIGEST") == f"OK {hashlib.sha256(OTHER_TABLE).hexdigest()}"


def test_serial_lines_that_are_none():
    pytest.importorskip("serial")
    with pytest.raises(LinkError, match="no plate processor answers at /no/such/device"):
        open_link("/no/such/device", retries=0)
    with pytest.raises(LinkError, match="'what://ever' is not a link"):
        open_link("what://ever", retries=0)
    with pytest.raises(LinkError, match="is not a plate processor: it said 'VERSION'"):  # it says what it is told
        open_link("loop://", timeout_s=0.2, retries=0)


def test_the_bare_stages():
    with served(bare_stages()) as port, open_link(f"tcp://127.0.0.1:{port}") as link:
        assert link.greeting.state == "EMPTY"
        assert link.drive_plate("LOWER", -3.0, 4.0) == ("-", (0.0, 0.0), (-3.0, 4.0))
        link.foot("RIGHT")
        assert link.next_event() == Event("RIGHT", plates=((0.0, 0.0), (-3.0, 4.0)))
