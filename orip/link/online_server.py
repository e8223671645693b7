"""The server of `orip online --listen`: requests of several programs as lines of JSON, of which one may write.

The first client writes; when it leaves, the next one that asks for something that changes the session does. All others
watch: they may ask to be shown something, and get what is answered to the one that writes, as ``{"watched": ...}``.
Requests are answered one at a time. A client that breaks off leaves the session as its last whole line made it.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
from collections.abc import Awaitable, Callable, Iterator
from functools import partial
from typing import Any, NamedTuple

Reply = dict[str, Any]

LONGEST_LINE = 4096
"""Bytes of a request; of a longer one the rest is passed over."""

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
    """A session that is served over TCP."""

    def __init__(self, answering: Answering) -> None:
        self._answering = answering
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
            for client in list(self._clients):
                client.close()
            if self._serving:
                await asyncio.wait(set(self._serving), timeout=_ENDING_S)

    async def _serve_client(self, stream: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        host, port = (writer.get_extra_info("peername") or ("unknown", 0))[:2]
        self._clients[writer] = f"{host}:{port}"
        task = asyncio.current_task()
        assert task is not None, "asyncio calls it in a task"
        self._serving.add(task)
        try:
            self._writing = self._writing or writer
            self._say(
                writer, {**self._answering.greeting(), "role": "writes" if self._writing is writer else "watches"}
            )
            while not writer.is_closing() and (line := await _next_line(stream)) is not None:
                if line.strip() and not self._answer(writer, line):
                    break
                await writer.drain()
        except OSError:
            writer.transport.abort()
        finally:
            self._serving.discard(task)
            del self._clients[writer]
            if self._writing is writer:
                self._writing = None
            writer.close()

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


def _called_soon(loop: asyncio.AbstractEventLoop, action: Callable[[], None]) -> None:
    """Have an event loop do something soon, from any thread; nothing where it has ended."""
    with contextlib.suppress(RuntimeError):
        loop.call_soon_threadsafe(action)


async def _next_line(stream: asyncio.StreamReader) -> str | None:
    """Return the next line; None at the end, where a line without an end is none. One too long comes cut."""
    begin = b""
    while True:
        try:
            line = await stream.readuntil(b"\n")
        except asyncio.IncompleteReadError:
            return None
        except asyncio.LimitOverrunError as overrun:
            begin = begin or (await stream.readexactly(overrun.consumed))[:LONGEST_LINE] + b"..."
            continue
        return (begin or line).decode("utf-8", errors="replace")


def _only_shows(line: str) -> bool:
    """Tell whether a request changes nothing."""
    try:
        request = json.loads(line)
    except (ValueError, RecursionError):
        return True  # answered with what is wrong
    return not isinstance(request, dict) or request.get("do") in ("show", "quit")
