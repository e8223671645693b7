"""The emulator over real sockets: who operates, downloads that break off, and clients that behave badly."""

from __future__ import annotations

import hashlib
import random
import socket
import struct
import threading
import time
from contextlib import suppress

import pytest
from link.served import IMPATIENT, OTHER_TABLE, TABLE, Raw, loaded_station, served
from support.long_cases import every

from orip.multimodel.link.emulator import MOST_TABLE_LINES
from orip.multimodel.link.station import Pace, bare_stages

DIGEST = f"OK {hashlib.sha256(TABLE).hexdigest()}"
OTHER_DIGEST = f"OK {hashlib.sha256(OTHER_TABLE).hexdigest()}"
DAMAGED = OTHER_TABLE.replace(b"P1-2", b"P1-9", 1)
LINES = OTHER_TABLE.splitlines(keepends=True)


@pytest.fixture
def port():
    with served(patience=IMPATIENT) as port:
        yield port


def download(client, table=OTHER_TABLE):
    client.send(b"DOWNLOAD %d\n" % table.count(b"\n") + table)
    return client.read()


def eventually(ask, expected, seconds=30.0):
    """Ask until the answer is the one that is expected: what a client has sent is read at its own time."""
    deadline = time.monotonic() + seconds
    while (found := ask()) != expected and time.monotonic() < deadline:
        time.sleep(0.02)
    assert found == expected


def cut(client):
    """End a connection at once, as a machine does that is switched off: the other side gets a reset."""
    client.socket.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
    client.close()


def unharmed(port, digest=DIGEST):
    """Check that the table is unchanged, and that an operator is served."""
    with Raw(port) as client:
        assert client.ask("DIGEST") == digest
        eventually(lambda: client.ask("OPERATE"), "OK OPERATOR")
        for line in ("LOCK NONE", "AUTO ON", "MODEL M1-1"):
            assert client.ask(line).startswith("OK MODEL ")
        assert client.ask("DRIVE OBJECT 30 0 0") == "OK MODEL M1-2 UPPER 45.0050 60.1050 LOWER 34.9950 59.8950"


def test_greeting_and_farewell(port):
    with Raw(port) as client:
        assert client.greeting == "OK KDPP-EMU 1 READY"
        assert client.ask("QUIT") == "OK BYE"
        assert client.read() == ""
    with served(bare_stages()) as empty, Raw(empty) as client:
        assert client.greeting == "OK KDPP-EMU 1 EMPTY"


def test_requests_in_one_piece_and_in_single_bytes(port):
    with Raw(port) as client:
        client.send(b"DRIVE OBJECT 30 0 0\r\nPOS OBJECT\nMODEL?\r\n")
        assert client.read() == "OK MODEL M1-2 UPPER 45.0050 60.1050 LOWER 34.9950 59.8950"
        assert [client.read(), client.read()] == ["OK 30.0000 0.0000 0.0000", "OK M1-2"]
        for byte in b"DRIVE OBJECT 10 0 0\n":
            client.send(bytes([byte]))
        assert client.read().startswith("OK MODEL M1-1 ")


def test_one_operates_and_all_read(port):
    with Raw(port) as operator, Raw(port) as first, Raw(port) as second:
        assert operator.ask("DRIVE OBJECT 30 0 0").startswith("OK")
        for observer in (first, second):
            assert observer.greeting == f"OK KDPP-EMU 1 READY OBSERVER {operator.address}"
            assert observer.ask("POS OBJECT") == "OK 30.0000 0.0000 0.0000"
            for line in ("DRIVE OBJECT 10 0 0", "CLEAR", "EVENT", "OPERATE"):
                assert observer.ask(line).startswith(f"ERR 110 operated by {operator.address}")
            assert observer.ask("POS OBJECT") == "OK 30.0000 0.0000 0.0000"
        assert operator.ask("OPERATE") == "OK OPERATOR"
        assert operator.ask("QUIT") == "OK BYE"
        assert first.ask("DRIVE OBJECT 10 0 0").startswith("ERR 110 operated by nobody")
        eventually(lambda: first.ask("OPERATE"), "OK OPERATOR")
        assert first.ask("DRIVE OBJECT 10 0 0").startswith("OK MODEL M1-1 ")
        assert second.ask("VERSION") == f"OK KDPP-EMU 1 READY OBSERVER {first.address}"


def test_the_role_is_given_back(port):
    with Raw(port) as one, Raw(port) as other:
        assert one.ask("OBSERVE") == "OK OBSERVER"
        assert one.ask("NEXT").startswith("ERR 110 operated by nobody; OPERATE takes the role")
        assert other.ask("OPERATE") == "OK OPERATOR"
        assert one.ask("OBSERVE") == "OK OBSERVER"
        assert one.ask("OPERATE").startswith(f"ERR 110 operated by {other.address}")
    with Raw(port) as next_one:
        eventually(lambda: next_one.ask("OPERATE"), "OK OPERATOR")


def test_an_operator_beside_a_host(port):
    """A program that measures holds the host's role; who sits at the panel moves, presses and is heard."""
    with Raw(port) as host:
        assert host.ask("HOST") == "OK HOST"
        with Raw(port) as panel, Raw(port) as third:
            assert panel.greeting == "OK KDPP-EMU 1 READY"
            assert panel.ask("OPERATE") == "OK OPERATOR"
            assert third.ask("OPERATE").startswith(f"ERR 110 operated by {panel.address}")
            assert third.ask("MOVE 1 1").startswith(f"ERR 110 operated by {panel.address}")
            assert panel.ask("GUIDE UPPER").startswith("OK ")
            assert panel.ask("MOVE 1 -1") == "OK MODEL M1-1 UPPER 35.9950 58.8950 LOWER 25.0050 60.1050"
            assert panel.ask("FOOT RIGHT").startswith("OK ")
            assert panel.ask("EVENT").startswith(f"ERR 110 hosted by {host.address}")
            assert download(panel).startswith(f"ERR 110 hosted by {host.address}")
            assert panel.ask("HOST").startswith(f"ERR 110 hosted by {host.address}")
            assert host.ask("EVENT") == "OK RIGHT UPPER 35.9950 58.8950 LOWER 25.0050 60.1050"
            assert host.ask("MOVE -1 1").startswith("OK MODEL M1-1 ")
            assert host.ask("OBSERVE") == "OK OBSERVER"
            assert panel.ask("EVENT") == "OK NONE"
            assert panel.ask("HOST") == "OK HOST"
        eventually(lambda: host.ask("OPERATE"), "OK OPERATOR")
        assert host.ask("NEXT").startswith("OK ")


def test_a_host_comes_while_somebody_operates(port):
    with Raw(port) as panel, Raw(port) as host:
        assert host.ask("HOST") == "OK HOST"
        assert panel.ask("MOVE 0 0").startswith("OK ")
        assert panel.ask("NEXT").startswith(f"ERR 110 hosted by {host.address}")
        assert host.ask("NEXT").startswith("OK ")
        host.close()
        eventually(lambda: panel.ask("EVENT"), "OK NONE")


def test_download(port):
    with Raw(port) as client:
        assert download(client) == "OK LOADED cameras 1 photos 3 models 2"
        assert client.ask("DIGEST") == OTHER_DIGEST
        assert download(client, TABLE.replace(b"\n", b"\r\n")) == "OK LOADED cameras 1 photos 10 models 8"
        assert client.ask("DIGEST") == DIGEST


def test_an_observers_download_is_read_and_refused(port):
    with Raw(port) as operator, Raw(port) as observer:
        assert download(observer).startswith("ERR 110 ")
        assert observer.ask("DIGEST") == operator.ask("DIGEST") == DIGEST


def test_a_damaged_table_is_not_loaded(port):
    with Raw(port) as client:
        assert download(client, DAMAGED).startswith("ERR 121 ")
        assert client.ask("DIGEST") == DIGEST


@pytest.mark.parametrize("how", ["closed", "reset", "half-closed"])
def test_a_download_that_is_cut_at_every_line(port, how):
    sent = [b"".join(LINES[:count]) for count in range(len(LINES))] + [OTHER_TABLE[:-1]]
    for part in sent:
        client = Raw(port)
        eventually(lambda client=client: client.ask("OPERATE"), "OK OPERATOR")
        client.send(b"DOWNLOAD %d\n" % len(LINES) + part)
        if how == "half-closed":
            client.socket.shutdown(socket.SHUT_WR)
            assert client.read().startswith("ERR 121 the download broke off")
            assert client.read() == ""
        if how == "reset":
            cut(client)
        else:
            client.close()
    unharmed(port)


def test_a_download_that_comes_no_further_is_given_up(port):
    with Raw(port) as client, Raw(port) as observer:
        client.send(b"DOWNLOAD %d\n" % len(LINES) + b"".join(LINES[:5]) + b"half a li")
        assert observer.ask("DIGEST") == DIGEST
        assert client.read().startswith("ERR 121 the download broke off")
        assert client.read() == ""
    unharmed(port)


def test_downloads_that_are_too_large(port):
    with Raw(port) as client:
        long = LINES[0][:-1] + b"x" * 200_000 + b"\n"
        client.send(b"DOWNLOAD %d\n" % len(LINES) + long + b"".join(LINES[1:]))
        assert client.read().startswith("ERR 123 line 1 ")
        assert client.ask("DOWNLOAD many").startswith("ERR 102 ")
        assert client.ask("DOWNLOAD -1").startswith("ERR 102 ")
        assert client.ask("DOWNLOAD 0").startswith("ERR 121 ")
        assert client.ask("DIGEST") == DIGEST
        assert client.ask(f"DOWNLOAD {MOST_TABLE_LINES + 1}").startswith("ERR 123 ")
        assert client.read() == ""
    unharmed(port)


def test_lines_that_are_too_long(port):
    with Raw(port) as client:
        for length in (513, 4094, 4095, 4096, 4097, 4098, 4099, 8200, 1_000_000):
            client.send(b"x" * length + b"\nMODEL?\n")
            assert client.read().startswith("ERR 103 ")
            assert client.read() == "OK M1-1"
        client.send(b"y" * 100_000)
    unharmed(port)


def test_a_client_that_has_said_all_is_answered(port):
    """It closes its sending side alone; an unfinished line is no request."""
    with Raw(port) as client:
        client.send(b"DRIVE OBJECT 30 0 0\nPOS OBJECT\nDRIVE OBJECT 1")
        client.socket.shutdown(socket.SHUT_WR)
        assert client.read().startswith("OK MODEL M1-2 ")
        assert [client.read(), client.read()] == ["OK 30.0000 0.0000 0.0000", ""]


def test_a_client_that_does_not_read_holds_up_nobody(port):
    with Raw(port) as greedy, Raw(port) as observer:
        greedy.socket.setblocking(False)
        with suppress(BlockingIOError):  # nothing more is taken from it
            for _ in range(100_000):
                greedy.socket.send(b"PROFILE 0 0 0 80 0 0 0.01\n" * 100)
        # a profile of 8000 points takes some 0.1 s to calculate; between two of them others are answered
        assert observer.ask("DIGEST") == DIGEST
        eventually(lambda: observer.ask("OPERATE"), "OK OPERATOR", 60.0)
    unharmed(port)


def test_many_clients_at_once(port):
    problems = []

    def work(number):
        try:
            with Raw(port) as client:
                for _ in range(50):
                    assert client.ask("DIGEST") == DIGEST
                    assert client.ask("WHICH 30 0 0") == "OK M1-2"
        except (AssertionError, OSError) as error:
            problems.append((number, error))

    threads = [threading.Thread(target=work, args=(number,)) for number in range(20)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not problems


@pytest.mark.parametrize("count", every(2, [30, 1000]))
def test_cut_connections(port, count):
    """Connect, send something, all or part of it, and leave in one way or another; the table is to stay what it is."""
    chance = random.Random(count)
    requests = [b"DRIVE OBJECT 30 0 0\n", b"POS OBJECT\n", b"PROFILE 0 0 0 80 0 0 0.05\n", b"NEXT\n", b"\n", b"\0\xff"]
    requests += [b"x" * 5000, b"DOWNLOAD 30\n", b"DOWNLOAD %d\n" % len(LINES) + DAMAGED, b"OPERATE\n"]
    for number in range(count):
        client = Raw(port)
        with suppress(OSError):  # a download that was refused, or given up, ends the connection
            for _ in range(chance.randrange(6)):
                request = chance.choice(requests)
                client.send(request[: chance.randrange(len(request) + 1)])
            if chance.random() < 0.2:
                client.socket.shutdown(socket.SHUT_WR)
        cut(client) if chance.random() < 0.5 else client.close()
        if number % 100 == 99:
            with Raw(port) as other:
                assert other.ask("DIGEST") == DIGEST
    unharmed(port)


@pytest.mark.parametrize("count", every(2, [1000, 100_000]))
def test_any_lines(port, count):
    """Send lines of words of the protocol in any order, and of any bytes, all but what is to end or to replace things.

    An observer sends even these.
    """
    chance = random.Random(count)
    words = (
        b"DRIVE MOVE POS MODEL NEXT STATUS LOCK PRISM GUIDE FOOT KEY EVENT WHICH FORWARD VERSION LIMITS AUTO".split()
    )
    words += b"OBJECT PLATE PHOTO P1-1 M1-3 LEFT UPPER NONE OFF 90 1e9 -3.5 30 0 nan".split()
    with Raw(port) as operator, Raw(port) as observer:
        for client, more in ((operator, []), (observer, [b"CLEAR", b"PROFILE", b"OPERATE"])):
            for _ in range(count // 200):
                lines = [b" ".join(chance.choices(words + more, k=chance.randrange(1, 6))) for _ in range(80)]
                lines += [chance.randbytes(chance.randrange(600)).replace(b"\n", b"") for _ in range(20)]
                chance.shuffle(lines)
                client.send(b"\n".join(lines) + b"\nDIGEST\n")
                replies = [client.read() for _ in lines]
                assert all(reply.startswith(("OK ", "ERR ")) for reply in replies)
                assert client.read() == DIGEST
    unharmed(port)


def test_travel_takes_time():
    """100 mm at 200 mm/s: half a second on the way, in steps of 10 ms; what is digitised is where the stage is."""
    with served(bare_stages(), pace=Pace(200.0, 100.0)) as port, Raw(port) as client:
        assert client.ask("STATUS").endswith(" MOVING NO")
        start = time.monotonic()
        assert client.ask("DRIVE PLATE UPPER 60 80") == "OK MODEL - UPPER 60.0000 80.0000 LOWER 0.0000 0.0000"
        assert client.ask("STATUS").endswith(" MOVING YES")
        client.ask("FOOT RIGHT")
        after = time.monotonic() - start
        x, y = map(float, client.ask("EVENT").split()[3:5])
        assert y == pytest.approx(x * 4.0 / 3.0, abs=0.001)
        assert 0.0 <= x <= 60.0 * after / 0.5 + 0.001
        assert x % 1.2 == pytest.approx(0.0, abs=0.002) or x % 1.2 == pytest.approx(1.2, abs=0.002)
        eventually(lambda: client.ask("STATUS")[-10:], " MOVING NO")
        assert time.monotonic() - start >= 0.5
        assert client.ask("POS PLATE") == "OK UPPER 60.0000 80.0000 LOWER 0.0000 0.0000"


def test_what_is_kept():
    """A download at once; movements at the end at the latest; nothing where nothing has changed."""
    kept = []
    with served(keep=kept.append) as port, Raw(port) as client:
        client.ask("POS OBJECT")
        assert kept == []
        download(client)
        assert [station.table for station in kept] == [OTHER_TABLE]
        client.ask("DRIVE OBJECT 30 0 0")
    assert kept[-1].mark.xyz == (30.0, 0.0, 0.0)
    assert kept[-1].mark.model == "M1-2"
    mark = loaded_station().mark
    assert loaded_station().at(mark).mark == mark


def test_the_end_does_not_wait_for_clients():
    """One talks, one is in the middle of a download, one does not read."""
    with served(patience=IMPATIENT) as port:
        clients = [Raw(port), Raw(port), Raw(port)]
        clients[0].send(b"DOWNLOAD 100\nhalf")
        clients[1].send(b"HELP\n" * 2000)
        start = time.monotonic()
    assert time.monotonic() - start < 5.0
    for client in clients:
        client.close()
