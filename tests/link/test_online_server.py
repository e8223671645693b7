"""Several programs at one session: one writes, others watch; who breaks off, or sends rubbish, harms nobody."""

from __future__ import annotations

import asyncio
import contextlib
import json
from collections.abc import Awaitable, Callable, Iterator
from typing import Any

import pytest

from orip.online import server as online_server
from orip.online.server import LONGEST_LINE, Answering, OnlineServer
from orip.web.access import MOST_CLIENTS, MOST_WAITING

TOKEN = "a-token_of-this-test"
HEADS = (
    b"POST / HTTP/1.1", b"GET / HTTP/1.1", b"BREW /pot HTTP/1.0", b"PRI * HTTP/2.0", b"OPTIONS * HTTP/1.1",
    b"Host: evil.example", b"post / http/1.1", b"Origin:null", b" POST / HTTP/1.1", b"GET /",
)  # fmt: skip


class _Session:
    def __init__(self) -> None:
        self.lines: list[str] = []
        self.others: list[dict[str, Any]] = []
        self.wake: Callable[[], None] = lambda: None

    def reply(self, line: str) -> dict[str, Any] | None:
        try:
            do = json.loads(line)["do"]
        except (ValueError, TypeError, KeyError, RecursionError):
            return {"error": "no request"}
        if do == "quit":
            return None
        if do != "show":
            self.lines.append(line.strip())
        return {"state": "included", "number": len(self.lines)}

    def on_news(self, wake: Callable[[], None]) -> None:
        self.wake = wake

    def news(self) -> Iterator[dict[str, Any]]:
        while self.others:
            yield self.others.pop(0)


class _Client:
    def __init__(self, stream: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self.stream, self.writer = stream, writer

    async def heard(self) -> dict[str, Any]:
        return dict(json.loads(await asyncio.wait_for(self.stream.readline(), 5.0)))

    async def asked(self, **request: Any) -> dict[str, Any]:
        self.writer.write(json.dumps(request).encode() + b"\n")
        return await self.heard()


def _run(
    talk: Callable[[_Session, Callable[[], Awaitable[_Client]]], Awaitable[None]], token: str | None = None
) -> None:
    async def run() -> None:
        session, end, port = _Session(), asyncio.Event(), asyncio.get_running_loop().create_future()
        server = OnlineServer(Answering(lambda: {"summary": ""}, session.reply, session.news, session.on_news), token)
        serving = asyncio.create_task(server.serve("127.0.0.1", 0, lambda _, at: port.set_result(at), end.wait()))
        number = await port

        clients: list[_Client] = []

        async def connect() -> _Client:
            clients.append(_Client(*await asyncio.open_connection("127.0.0.1", number)))
            return clients[-1]

        await talk(session, connect)
        end.set()
        await serving
        for client in clients:
            client.writer.close()
            with contextlib.suppress(OSError):
                await client.writer.wait_closed()

    asyncio.run(run())


def test_the_first_writes_and_others_watch() -> None:
    async def talk(session: _Session, connect: Callable[[], Awaitable[_Client]]) -> None:
        first, second = await connect(), await connect()
        assert (await first.heard())["role"] == "writes"
        assert (await second.heard())["role"] == "watches"
        assert (await first.asked(do="measure"))["number"] == 1
        assert (await second.heard())["watched"]["number"] == 1
        assert "is measuring" in (await second.asked(do="measure"))["error"]
        assert (await second.asked(do="show"))["number"] == 1
        assert len(session.lines) == 1
        first.writer.write(b'{"do": "quit"}\n')
        assert await first.stream.readline() == b""
        assert (await second.asked(do="measure"))["number"] == 2

    _run(talk)


def test_a_client_that_breaks_off_within_a_line_has_said_nothing() -> None:
    async def talk(session: _Session, connect: Callable[[], Awaitable[_Client]]) -> None:
        first = await connect()
        await first.heard()
        first.writer.write(b'{"do": "measure"')
        first.writer.transport.abort()
        second = await connect()
        await second.heard()
        assert (await second.asked(do="measure"))["number"] == 1
        assert session.lines == ['{"do": "measure"}']

    _run(talk)


def test_rubbish_is_answered_and_changes_nothing() -> None:
    async def talk(session: _Session, connect: Callable[[], Awaitable[_Client]]) -> None:
        client = await connect()
        await client.heard()
        for line in (b"\xff\xfe\x00", b"[]", b'{"do": "measure", "point": "\xff"}', b"[" * 4000):
            client.writer.write(line + b"\n")
            assert "error" in await client.heard()
        assert not session.lines
        assert (await client.asked(do="measure"))["number"] == 1

    _run(talk)


@pytest.mark.parametrize("length", [LONGEST_LINE + 1, 5000, 3 * LONGEST_LINE, 300_000])
def test_a_long_line_in_two_pieces_ends_its_connection_and_no_other(length: int) -> None:
    async def talk(session: _Session, connect: Callable[[], Awaitable[_Client]]) -> None:
        first, second = await connect(), await connect()
        await first.heard()
        await second.heard()
        with contextlib.suppress(ConnectionError):  # who goes on sending may be cut off
            for piece in (b'{"do": "measure"' + b" " * length, b" " * length, b"}\n"):
                second.writer.write(piece)
                await second.writer.drain()
                await asyncio.sleep(0.1)
        assert (await second.heard())["error"] == f"a request has at most {LONGEST_LINE} bytes; the connection ends"
        assert await asyncio.wait_for(second.stream.read(), 5.0) == b""
        assert (await first.asked(do="show"))["number"] == 0
        assert not session.lines

    _run(talk)


def test_the_token_is_said_first_or_nothing_is_carried_out(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(online_server, "TOKEN_S", 0.3)

    async def talk(session: _Session, connect: Callable[[], Awaitable[_Client]]) -> None:
        for first in (
            b'{"do": "measure"}', b'{"token": "no"}', b'{"token": null}', b'{"token": ["' + TOKEN.encode() + b'"]}',
            b"[]", b"[" * 400, b"\xff", b"\x16\x03\x01\x02\x00\x01", b"x" * 5000,
        ):  # fmt: skip
            client = await connect()
            assert await client.heard() == {"wants": "token"}
            client.writer.write(first + b'\n{"do": "measure"}\n')
            assert "is not the token" in (await client.heard())["error"]
            assert await asyncio.wait_for(client.stream.read(), 5.0) == b""
        silent = await connect()
        assert await silent.heard() == {"wants": "token"}
        assert await asyncio.wait_for(silent.stream.read(), 5.0) == b""
        assert not session.lines
        client = await connect()
        await client.heard()
        assert (await client.asked(token=TOKEN))["role"] == "writes"
        assert (await client.asked(do="measure"))["number"] == 1

    _run(talk, TOKEN)


@pytest.mark.parametrize("token", [None, TOKEN])
def test_a_page_of_the_web_that_posts_is_hung_up_on(token: str | None) -> None:
    async def talk(session: _Session, connect: Callable[[], Awaitable[_Client]]) -> None:
        for head in HEADS:
            client = await connect()
            await client.heard()
            client.writer.write(head + b'\r\nHost: 127.0.0.1\r\n\r\n{"do": "measure"}\n')
            with contextlib.suppress(ConnectionError):
                await asyncio.wait_for(client.stream.read(), 5.0)
        assert not session.lines

    _run(talk, token)


def test_many_that_wait_do_not_keep_out_who_has_the_token() -> None:
    async def talk(_: _Session, connect: Callable[[], Awaitable[_Client]]) -> None:
        waiting = [await connect() for _ in range(3 * MOST_WAITING)]
        client = await connect()
        await client.heard()
        assert (await client.asked(token=TOKEN))["role"] == "writes"
        ended = [one for one in waiting if one.stream.at_eof() or one.stream.exception()]
        for one in waiting:
            with contextlib.suppress(ConnectionError, TimeoutError):
                if (
                    await asyncio.wait_for(one.stream.readline(), 0.02)
                    and await asyncio.wait_for(one.stream.read(1), 0.02) == b""
                ):
                    ended.append(one)
        assert len(ended) >= MOST_WAITING

    _run(talk, TOKEN)


def test_no_more_programs_than_can_be_served() -> None:
    async def talk(_: _Session, connect: Callable[[], Awaitable[_Client]]) -> None:
        clients = [await connect() for _ in range(MOST_CLIENTS)]
        assert [(await client.heard())["role"] for client in clients] == ["writes", *["watches"] * (MOST_CLIENTS - 1)]
        assert "are connected already" in (await (await connect()).heard())["error"]
        assert (await clients[0].asked(do="measure"))["number"] == 1

    _run(talk)


def test_what_others_have_written_to_files_is_told_to_all() -> None:
    async def talk(session: _Session, connect: Callable[[], Awaitable[_Client]]) -> None:
        first, second = await connect(), await connect()
        await first.heard()
        await second.heard()
        session.others.append({"state": "suspect"})
        assert (await first.heard())["state"] == "suspect"
        assert (await second.heard())["state"] == "suspect"

    _run(talk)


def test_what_has_been_reconsidered_in_a_thread_is_told_to_all_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(online_server, "_LOOKS_EVERY_S", 60.0)

    async def talk(session: _Session, connect: Callable[[], Awaitable[_Client]]) -> None:
        first, second = await connect(), await connect()
        await first.heard()
        await second.heard()
        session.others.append({"reconsidered": {"state": "included"}})
        await asyncio.to_thread(session.wake)
        assert (await first.heard())["reconsidered"]["state"] == "included"
        assert (await second.heard())["reconsidered"]["state"] == "included"

    _run(talk)
