"""A plate processor that other machines can reach: nobody without the token is answered anything."""

from __future__ import annotations

import re
import signal
import socket
import subprocess
import sys

import pytest
from link.served import served

from orip.errors import LinkError
from orip.link.access import new_token, shows_token
from orip.link.client import observe_link, open_link
from orip.link.emulator import Patience

TOKEN = "a-token_of-this-test"


def said(port, *lines):
    """Return all that is answered to lines."""
    with socket.create_connection(("127.0.0.1", port), 10) as connection:
        connection.sendall("".join(f"{line}\n" for line in lines).encode())
        with connection.makefile("r") as replies:
            return [reply.rstrip("\n") for reply in replies]


@pytest.fixture(scope="module")
def port():
    with served(token=TOKEN, patience=Patience(token_s=0.5)) as found:
        yield found


WRONG = ("TOKEN", "TOKEN ", f"TOKEN {TOKEN[:-1]}", f"TOKEN {TOKEN}x", "TOKEN " + "x" * 9000)


@pytest.mark.parametrize("first", ["STATUS", f"STATUS {TOKEN}", TOKEN, *WRONG])
def test_who_has_no_token_gets_403_and_is_hung_up_on(port, first):
    replies = said(port, first, "FORWARD", "STATUS")
    assert replies[0] == "OK KDPP-EMU 1 TOKEN"
    assert replies[1].startswith("ERR 403 ")
    assert len(replies) == 2


def test_who_says_nothing_is_hung_up_on(port):
    assert said(port) == ["OK KDPP-EMU 1 TOKEN"]


def test_the_token_of_the_url_lets_in(port):
    with open_link(f"tcp://{TOKEN}@127.0.0.1:{port}") as link:
        assert link.status().condition
        assert TOKEN not in link.url


def test_who_waits_without_a_token_does_not_become_the_operator(port):
    with socket.create_connection(("127.0.0.1", port), 10), open_link(f"tcp://{TOKEN}@127.0.0.1:{port}") as link:
        assert link.forward()


@pytest.mark.parametrize(("given", "what"), [("", "wants a token"), ("wrong@", "does not take this token")])
def test_a_link_without_the_token_says_what_to_do(port, given, what):
    with pytest.raises(LinkError, match=f"{what}.*; give the link as 'orip drive emulate' has printed it"):
        observe_link(f"tcp://{given}127.0.0.1:{port}")


def test_a_token_in_the_url_of_a_processor_that_wants_none_does_no_harm():
    with served() as port, open_link(f"tcp://{TOKEN}@127.0.0.1:{port}") as link:
        assert link.status().condition


def test_tokens_are_new_and_compared_as_a_whole():
    tokens = {new_token() for _ in range(100)}
    assert len(tokens) == 100
    assert all(re.fullmatch(r"[A-Za-z0-9_-]{22}", token) for token in tokens)
    assert shows_token(b"token " + TOKEN.encode(), TOKEN)
    assert not shows_token(b"TOKEN \xff\xfe", TOKEN)


def test_the_command_warns_and_prints_the_link():
    words = ["-m", "orip.cli.main", "drive", "emulate", "--listen", "0.0.0.0:0", "--allow-remote"]
    process = subprocess.Popen([sys.executable, *words], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        first = process.stdout.readline()
        token, port = re.search(r"; link tcp://([\w-]{22})@0\.0\.0\.0:([0-9]+)\n", first).groups()
        with open_link(f"tcp://{token}@127.0.0.1:{port}") as link:
            assert link.status().condition
        assert said(int(port), "STATUS")[1].startswith("ERR 403")
    finally:
        process.send_signal(signal.SIGINT)
        _, talk = process.communicate(timeout=20)
    assert "warning: --allow-remote: whoever can reach this machine and has the token" in talk
