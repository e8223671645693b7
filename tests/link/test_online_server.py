"""Several programs at one session: one writes, others watch; who breaks off, or sends rubbish, harms nobody."""

from __future__ import annotations

import asyncio
import contextlib
import json
from collections.abc import Awaitable, Callable, Iterator
from typing import Any

import pytest

from orip.link import online_server
from orip.link.online_server import LONGEST_LINE, Answering, OnlineServer


class _Session:
    def __init__(self) -> None:
        self.lines: list[str] = []
        self.others: list[dict[str, Any]] = []
        self.wake: Callable[[], None] = lambda: None

    def reply(self, line: str) -> dict[str, Any] | None:
        try:
            do = json.loads(line)["do"]
        except (ValueError, TypeError, KeyError):
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


def _run(talk: Callable[[_Session, Callable[[], Awaitable[_Client]]], Awaitable[None]]) -> None:
    async def run() -> None:
        session, end, port = _Session(), asyncio.Event(), asyncio.get_running_loop().create_future()
        server = OnlineServer(Answering(lambda: {"summary": ""}, session.reply, session.news, session.on_news))
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


def test_rubbish_and_long_lines_are_answered_and_change_nothing() -> None:
    async def talk(session: _Session, connect: Callable[[], Awaitable[_Client]]) -> None:
        client = await connect()
        await client.heard()
        for line in (
            b"\xff\xfe\x00",
            b"[]",
            b"x" * (3 * LONGEST_LINE),
            b'{"do": "measure"' + b" " * LONGEST_LINE + b"}",
        ):
            client.writer.write(line + b"\n")
            assert "error" in await client.heard()
        assert not session.lines
        assert (await client.asked(do="measure"))["number"] == 1

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
