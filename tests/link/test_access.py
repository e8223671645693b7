"""Who may use a plate processor: nobody without the token is answered anything, and the user's own commands find it."""

from __future__ import annotations

import os
import re
import signal
import socket
import subprocess
import sys
import threading
from contextlib import ExitStack, contextmanager, suppress

import pytest
from cli.command_line import orip
from link.served import served

from orip.errors import LinkError
from orip.multimodel.link.client import observe_link, open_link
from orip.multimodel.link.emulator import Patience
from orip.web.access import MOST_CLIENTS, MOST_WAITING, new_token, shows_token, stored_token, token_kept

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


POSTED = b"OPERATE\nMOVE 1 2\nSTATUS\n"
POST = (
    b"POST / HTTP/1.1\r\nHost: 127.0.0.1\r\nUser-Agent: Mozilla/5.0\r\nOrigin: http://evil.example\r\n"
    b"Content-Type: text/plain;charset=UTF-8\r\nContent-Length: %d\r\n\r\n" % len(POSTED)
)


HELLO = b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\n"  # of TLS


@pytest.mark.parametrize(
    ("head", "token"),
    [(head, token) for head in (POST, b"GET /MOVE HTTP/1.1\r\n", b"Host: x\n") for token in (None, TOKEN)]
    + [(HELLO, TOKEN)],
)
def test_a_page_of_the_web_moves_nothing(head, token):
    with served(token=token) as port:
        place = f"tcp://{TOKEN}@127.0.0.1:{port}"
        with observe_link(place) as link:
            before = link.position("PLATE")
        with socket.create_connection(("127.0.0.1", port), 10) as page:
            page.sendall(head + POSTED)
            said = b""
            with suppress(ConnectionError):
                while data := page.recv(1 << 16):
                    said += data
        assert said.startswith(b"OK KDPP-EMU 1 TOKEN\nERR 403 " if token else b"OK KDPP-EMU 1 READY\n")
        assert len(said.splitlines()) == (2 if token else 1)
        with observe_link(place) as link:
            assert link.position("PLATE") == before


def test_many_connections_do_not_keep_out_who_has_the_token():
    with served(token=TOKEN) as port, ExitStack() as stack:
        for _ in range(3 * MOST_WAITING):
            stack.enter_context(socket.create_connection(("127.0.0.1", port), 10))
        with open_link(f"tcp://{TOKEN}@127.0.0.1:{port}") as link:
            assert link.forward()


def test_no_more_programs_than_can_be_served():
    with served() as port, ExitStack() as stack:
        links = [stack.enter_context(observe_link(f"tcp://127.0.0.1:{port}")) for _ in range(MOST_CLIENTS)]
        with socket.create_connection(("127.0.0.1", port), 10) as one, one.makefile() as lines:
            assert lines.readline() == f"ERR 110 {MOST_CLIENTS} programs are connected already\n"
        assert links[0].status().condition


def test_the_token_is_in_a_file_of_the_users_alone_while_it_is_served(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_RUNTIME_DIR" if os.name == "posix" else "LOCALAPPDATA", str(tmp_path))
    with token_kept("127.0.0.1", 4788, TOKEN):
        (path,) = (tmp_path / "orip").iterdir()
        assert stored_token("127.0.0.1", 4788) == TOKEN
        assert stored_token("::1", 4788) is None  # whoever listens there may be somebody else
        if os.name == "posix":
            assert (path.stat().st_mode & 0o777, path.parent.stat().st_mode & 0o777) == (0o600, 0o700)
        with token_kept("127.0.0.1", 4788, "another"):
            assert stored_token("127.0.0.1", 4788) == "another"
    assert not path.exists()
    path.write_text("no\x1b[31mtoken", encoding="ascii")
    assert stored_token("127.0.0.1", 4788) is None


@pytest.mark.skipif(os.name != "posix", reason="permissions of POSIX")
def test_a_folder_that_others_may_write_to_holds_no_token(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    (tmp_path / "orip").mkdir(mode=0o700)
    (tmp_path / "orip").chmod(0o777)
    with token_kept("127.0.0.1", 4788, TOKEN):
        assert stored_token("127.0.0.1", 4788) is None
    (tmp_path / "orip").rmdir()
    (tmp_path / "elsewhere").mkdir(mode=0o700)
    (tmp_path / "orip").symlink_to(tmp_path / "elsewhere")
    with token_kept("127.0.0.1", 4788, TOKEN):
        assert list((tmp_path / "elsewhere").iterdir()) == []
    monkeypatch.setenv("HOME", str(tmp_path / "no" / "home"))
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path / "gone"))
    with token_kept("127.0.0.1", 4788, TOKEN):
        assert stored_token("127.0.0.1", 4788) == TOKEN


@contextmanager
def emulated(*words):
    """Run the command; yield its port and token."""
    listen = [] if "--listen" in words else ["--listen", "127.0.0.1:0"]
    process = subprocess.Popen(
        [sys.executable, "-m", "orip.cli.main", "drive", "emulate", *listen, *words],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    try:
        token, port = re.search(r"; link tcp://([\w-]{22})@[0-9.]+:([0-9]+)\n", process.stdout.readline()).groups()
        yield int(port), token
    finally:
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=20)


OTHER_ACCOUNT = """
import os, socket, sys
from orip.web.access import stored_token
"x".encode("idna"); os.setgroups([]); os.setgid(65534); os.setuid(65534)
with socket.create_connection(("127.0.0.1", int(sys.argv[1])), 10) as connection:
    connection.sendall(b"OPERATE\\nMOVE 1 2\\n")
    with connection.makefile() as lines:
        print(lines.read())
print("token", stored_token("127.0.0.1", int(sys.argv[1])))
"""


def test_commands_of_the_same_account_find_the_token_and_another_account_is_refused(tmp_path):
    with emulated() as (port, _):
        with open_link(f"tcp://127.0.0.1:{port}") as link:
            before = link.position("PLATE")
        assert orip(tmp_path, "drive", "where", "--link", f"tcp://localhost:{port}").code == 0
        if os.name == "posix" and os.geteuid() == 0:
            words = [sys.executable, "-c", OTHER_ACCOUNT, str(port)]
            said = subprocess.run(words, capture_output=True, text=True, check=False, timeout=60, cwd="/").stdout
            assert said.startswith("OK KDPP-EMU 1 TOKEN\nERR 403 "), said
            assert said.endswith("token None\n")
        with open_link(f"tcp://127.0.0.1:{port}") as link:
            assert link.position("PLATE") == before


def test_words_of_a_plate_processor_do_not_steer_the_terminal(tmp_path):
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]

        def greet():
            for line in (b"OK \x1b]0;title\x07\n", b"ERR 403 \x1b[2J\x9b\n"):
                connection, _ = server.accept()
                with connection:
                    connection.sendall(b"OK KDPP-EMU 1 READY\n" + line if b"403" in line else line)
                    connection.recv(100)

        thread = threading.Thread(target=greet)
        thread.start()
        told = [orip(tmp_path, "drive", verb, "--link", f"tcp://127.0.0.1:{port}").err for verb in ("where", "where")]
        thread.join()
    assert "\\x1b]0;title\\x07" in told[0]
    assert "\\x1b[2J" in told[1]
    assert not any(set("".join(told)) & set("\x1b\x07\x9b"))


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
