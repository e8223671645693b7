"""The server of `orip online --listen`: requests of several programs as lines of JSON, of which one may write.

The first client writes; when it leaves, the next one that asks for something that changes the session does. All others
watch: they may ask to be shown something, and get what is answered to the one that writes, as ``{"watched": ...}``.
Requests are answered one at a time. A client that breaks off leaves the session as its last whole line made it. Who
connects says the token first, ``{"token": "..."}``, as `orip.web.access` tells.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import socket
from collections.abc import Awaitable, Callable, Iterator
from functools import partial
from typing import Any, NamedTuple

from orip.web.access import MOST_CLIENTS, Door, hang_up, is_of_browser, is_token

Reply = dict[str, Any]

LONGEST_LINE = 4096
"""Bytes of a request; a longer one ends the connection."""

TOKEN_S = 10.0
"""Seconds to wait for the token."""

_LOOKS_EVERY_S = 0.5
"""Seconds after which is looked for what others have written to measurement files."""

_ENDING_S = 1.0
"""Seconds for connections to end."""

_LARGEST_BACKLOG = 1024 * 1024
"""Bytes that a client has not read; with more the connection ends."""


class Answering(NamedTuple):
    """What answers requests.

    Attributes
    ----------
    greeting : function
        What a client is told first.
    reply : function of a line
        None: the client wants to leave.
    news : function
        What there is to say that nobody has asked for: of measurements that others have written to files, and of
        earlier ones that have been reconsidered.
    on_news : function of a function
        Has it called, in any thread, when there may be news that are no files'.
    """

    greeting: Callable[[], Reply]
    reply: Callable[[str], Reply | None]
    news: Callable[[], Iterator[Reply]]
    on_news: Callable[[Callable[[], None]], None]


class OnlineServer:
    """A session that is served over TCP, to whoever has the token; None: to everybody."""

    def __init__(self, answering: Answering, token: str | None = None) -> None:
        self._answering = answering
        self._door = None if token is None else _door(token)
        self._clients: dict[asyncio.StreamWriter, str] = {}
        self._serving: set[asyncio.Task[None]] = set()
        self._writing: asyncio.StreamWriter | None = None

    async def serve(self, host: str, port: int, listening: Callable[[str, int], None], end: Awaitable[object]) -> None:
        """Serve until `end` comes; `listening` is called with the address and port.

        Raises
        ------
        OSError
            If the address cannot be listened at.
        """
        server = await asyncio.start_server(self._serve_client, host, port, limit=LONGEST_LINE)
        loop = asyncio.get_running_loop()
        self._answering.on_news(partial(_called_soon, loop, self._tell_news))
        looking = asyncio.create_task(self._look_for_news())
        try:
            listening(*server.sockets[0].getsockname()[:2])
            await end
        finally:
            server.close()
            looking.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await looking
            for client in [*self._clients, *(self._door.waiting if self._door is not None else ())]:
                client.close()
            if self._serving:
                await asyncio.wait(set(self._serving), timeout=_ENDING_S)

    async def _serve_client(self, stream: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        task = asyncio.current_task()
        assert task is not None, "asyncio calls it in a task"
        self._serving.add(task)
        try:
            writer.get_extra_info("socket").setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
            if self._door is not None:
                self._say(writer, {"wants": "token"})
                if not await self._door.lets_in(stream, writer):
                    return
            await self._converse(stream, writer)
        except OSError:  # time-outs are of this class
            writer.transport.abort()
        finally:
            self._serving.discard(task)
            self._clients.pop(writer, None)
            if self._writing is writer:
                self._writing = None
            writer.close()

    async def _converse(self, stream: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        if len(self._clients) >= MOST_CLIENTS:
            self._say(writer, {"error": f"{MOST_CLIENTS} programs are connected already"})
            await hang_up(stream, writer)
            return
        host, port = (writer.get_extra_info("peername") or ("unknown", 0))[:2]
        self._clients[writer] = f"{host}:{port}"
        self._writing = self._writing or writer
        self._say(writer, {**self._answering.greeting(), "role": "writes" if self._writing is writer else "watches"})
        try:
            while not writer.is_closing():
                line = await stream.readuntil(b"\n")
                if is_of_browser(line):  # some page of the web: what follows are its words, not those of a program
                    return
                if line.strip() and not self._answer_bytes(writer, line):
                    return
                await writer.drain()
        except asyncio.IncompleteReadError:  # a line without an end is none
            pass
        except asyncio.LimitOverrunError:
            self._say(writer, {"error": f"a request has at most {LONGEST_LINE} bytes; the connection ends"})
            await hang_up(stream, writer)

    def _answer_bytes(self, writer: asyncio.StreamWriter, line: bytes) -> bool:
        """Answer a line, if it is text; return whether the client stays."""
        try:
            return self._answer(writer, line.decode("utf-8"))
        except UnicodeDecodeError as error:
            self._say(
                writer, {"error": f"a request is text in UTF-8, which byte {error.start + 1} of this line is not"}
            )
            return True

    def _answer(self, writer: asyncio.StreamWriter, line: str) -> bool:
        """Answer a line; return whether the client stays."""
        if _only_shows(line):
            reply = self._answering.reply(line)
            if reply is not None:
                self._say(writer, reply)
            return reply is not None
        if self._writing not in (None, writer):
            assert self._writing is not None
            other = self._clients[self._writing]
            self._say(writer, {"error": f"{other} is measuring; until it leaves, this client can only show and watch"})
            return True
        self._writing = writer
        self._tell_news()
        reply = self._answering.reply(line)
        if reply is None:
            return False
        self._say(writer, reply)
        if "error" not in reply:
            self._tell_watching({"watched": reply}, writer)
        return True

    def _tell_news(self) -> None:
        for reply in self._answering.news():
            self._tell_watching(reply, None)

    def _tell_watching(self, reply: Reply, writing: asyncio.StreamWriter | None) -> None:
        for client in list(self._clients):
            if client is not writing:
                self._say(client, reply)

    def _say(self, writer: asyncio.StreamWriter, reply: Reply) -> None:
        if writer.transport.get_write_buffer_size() > _LARGEST_BACKLOG:
            writer.transport.abort()
        elif not writer.is_closing():
            writer.write(json.dumps(reply, ensure_ascii=False).encode() + b"\n")

    async def _look_for_news(self) -> None:
        while True:
            await asyncio.sleep(_LOOKS_EVERY_S)
            self._tell_news()


def _door(token: str) -> Door:
    def shows(line: bytes) -> bool:
        try:
            given = json.loads(line)
        except (ValueError, RecursionError):
            return False
        return isinstance(given, dict) and is_token(str(given.get("token")).encode("utf-8", "replace"), token)

    text = "that is not the token which 'orip online' has printed; it is said in the first line"
    refusal = json.dumps({"error": f'{text}: {{"token": "..."}}'}).encode() + b"\n"
    return Door(shows, refusal, TOKEN_S)


def _called_soon(loop: asyncio.AbstractEventLoop, action: Callable[[], None]) -> None:
    """Have an event loop do something soon, from any thread; nothing where it has ended."""
    with contextlib.suppress(RuntimeError):
        loop.call_soon_threadsafe(action)


def _only_shows(line: str) -> bool:
    """Tell whether a request changes nothing."""
    try:
        request = json.loads(line)
    except (ValueError, RecursionError):
        return True  # answered with what is wrong
    return not isinstance(request, dict) or request.get("do") in ("show", "quit")
