"""The emulated plate processor: one station, its clients over TCP, of which one operates, and the lines they send."""

from __future__ import annotations

import asyncio
import contextlib
import socket
import time
from collections.abc import Awaitable, Callable
from typing import NamedTuple

from msgspec import Struct

from orip.multimodel.link.messages import Refused, Request, whole_number
from orip.multimodel.link.protocol import NOBODY, Barred, answer, busy, downloaded, error, greeting, hosted, ok
from orip.multimodel.link.station import Pace, Station, TableLoader, Travel, on_the_way
from orip.records.drive_table import DriveCode, DriveFault
from orip.structs import replace
from orip.web.access import ASKING, MOST_CLIENTS, Door, hang_up, is_of_browser, shows_token

LONGEST_TABLE_LINE = 4096
"""Bytes; the longest line of a drive table, a set of 44 parameters, has some 1100."""


class LineReader:
    """Reads lines; one that is too long comes cut, but longer than any that is allowed.

    Parameters
    ----------
    stream : asyncio.StreamReader
        With a limit of `LONGEST_TABLE_LINE` + 2 bytes.
    """

    def __init__(self, stream: asyncio.StreamReader) -> None:
        self._stream = stream

    async def next(self) -> bytes | None:
        """Return the next line without its LF or CRLF; None at the end, where a line without an end is none."""
        begin = b""
        while True:
            try:
                line = await self._stream.readuntil(b"\n")
            except asyncio.IncompleteReadError:
                return None
            except asyncio.LimitOverrunError as overrun:
                part = await self._stream.readexactly(overrun.consumed)
                begin = begin or part[: LONGEST_TABLE_LINE + 1]
            else:
                return begin or line[:-1].removesuffix(b"\r")


# Requests are answered one at a time, so that each sees the station as a whole. What takes long or waits for somebody
# (a download, a client that does not read, a file) holds up nobody else. A client that breaks off leaves the station as
# its last whole request made it.

MOST_TABLE_LINES = 100_000
MOST_TABLE_BYTES = 64 * 1024 * 1024

LARGEST_BACKLOG = 64 * 1024
"""Bytes of replies that a client has not read yet; with more it is asked nothing until it reads."""

KEEP_PAUSE_S = 1.0
"""Between two writings of the state; a mark that is moved a thousand times a second is not written as often."""


class Patience(NamedTuple):
    """Seconds to wait for lines of a download, for a token, for a client to read its replies, and for all to leave."""

    download_s: float = 10.0
    token_s: float = 10.0
    reading_s: float = 10.0
    ending_s: float = 1.0


PATIENCE = Patience()


class _Client(Struct, eq=False):
    """One connection."""

    address: str
    lines: LineReader
    writer: asyncio.StreamWriter
    is_served: bool = False


class Emulator:
    """A plate processor that is served over TCP.

    Parameters
    ----------
    station : Station
        As it is in the beginning.
    keep : function of a Station, or None
        Writes it to a file; called from another thread, after a download at once, after movements within a second. It
        raises nothing.
    pace : Pace or None
        None: movements take no time.
    token : str or None
        What a client has to send first; None: nothing.
    """

    def __init__(
        self,
        station: Station,
        load: TableLoader,
        keep: Callable[[Station], None] | None = None,
        pace: Pace | None = None,
        patience: Patience = PATIENCE,
        token: str | None = None,
    ) -> None:
        self._door = None if token is None else _door(token, patience)
        self._station = replace(station, is_paced=pace is not None)
        self._load, self._keep, self._pace, self._patience = load, keep, pace, patience
        self._travel = Travel(station.state.plates, time.monotonic())
        self._clients: dict[_Client, asyncio.Task[None] | None] = {}
        self._operator: _Client | None = None
        self._host: _Client | None = None
        self._kept, self._keeping = station, asyncio.Lock()

    async def serve(self, host: str, port: int, listening: Callable[[str, int], None], end: Awaitable[object]) -> None:
        """Serve until `end` comes; `listening` is called with the address and port.

        Raises
        ------
        OSError
            If the address cannot be listened at.
        """
        server = await asyncio.start_server(self._serve_client, host, port, limit=LONGEST_TABLE_LINE + 2)
        keeper = asyncio.create_task(self._keep_from_time_to_time())
        try:
            listening(*server.sockets[0].getsockname()[:2])
            await end
        finally:
            server.close()
            await self._dismiss()
            async with self._keeping:  # what is being written is written to its end
                keeper.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await keeper
            await self._keep_now()

    async def _serve_client(self, stream: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        client = _Client(_address(writer), LineReader(stream), writer)
        self._clients[client] = asyncio.current_task()
        try:
            writer.get_extra_info("socket").setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
            writer.transport.set_write_buffer_limits(LARGEST_BACKLOG)
            if self._door is not None:
                writer.write(f"{ASKING}\n".encode("ascii"))
                if not await self._door.lets_in(stream, writer):
                    return
            if sum(other.is_served for other in self._clients) >= MOST_CLIENTS:
                writer.write(error(DriveFault(DriveCode.BUSY, f"{MOST_CLIENTS} programs are connected already")))
                await hang_up(stream, writer)
                return
            client.is_served = True
            self._operator = self._operator or client
            writer.write(greeting(self._station, self._other_operator(client)))
            await self._converse(client)
        except OSError:  # time-outs are of this class
            writer.transport.abort()
        finally:
            del self._clients[client]
            self._observe(client)
            writer.close()

    async def _converse(self, client: _Client) -> None:
        goes_on = True
        # once the connection is lost there is nobody to answer
        while goes_on and not client.writer.is_closing() and (line := await client.lines.next()) is not None:
            if is_of_browser(line):  # some page of the web: what follows are its words, not those of a program
                return
            found = answer(self._seen(), line, self._barred(client), self._other_operator(client))
            if found.connection is None:
                self._set(found.station)
                client.writer.write(found.reply)
            else:
                goes_on = await self._connection_verb(client, found.connection)
            await self._let_read(client)

    async def _connection_verb(self, client: _Client, request: Request) -> bool:
        """Do what concerns the connection; return whether it goes on."""
        if request.verb == "DOWNLOAD":
            return await self._download(client, request)
        if request.verb == "QUIT":
            client.writer.write(ok("BYE"))
            return False
        take = {"OBSERVE": self._observe, "OPERATE": self._operate, "HOST": self._become_host}[request.verb]
        client.writer.write(take(client))
        return True

    def _operate(self, client: _Client) -> bytes:
        self._operator = self._operator or client
        other = self._other_operator(client)
        return ok("OPERATOR") if other is None else error(busy(other))

    def _become_host(self, client: _Client) -> bytes:
        """Make a client the host; an operator's role that it has becomes free for who sits at the panel."""
        self._host = self._host or client
        if self._host is not client:
            return error(hosted(self._host.address))
        if self._operator is client:
            self._operator = None
        return ok("HOST")

    def _observe(self, client: _Client) -> bytes:
        if self._operator is client:
            self._operator = None
        if self._host is client:
            self._host = None
        return ok("OBSERVER")

    async def _download(self, client: _Client, request: Request) -> bool:
        try:
            count = whole_number(request.words[0])
        except Refused as refused:
            client.writer.write(error(refused.fault))
            return True
        if count > MOST_TABLE_LINES:  # who announces as much has sent it already: there is no way back into step
            client.writer.write(error(DriveFault(DriveCode.TABLE_TOO_LARGE, f"at most {MOST_TABLE_LINES} lines")))
            return False
        data = await self._table(client, count)
        if data is None:
            text = f"the download broke off before its {count} lines were there; the table is unchanged"
            client.writer.write(error(DriveFault(DriveCode.TABLE_DAMAGED, text)))
            return False
        fault = self._barred(client).host
        if fault is not None:
            client.writer.write(error(fault))
        elif len(data) > MOST_TABLE_BYTES:
            client.writer.write(error(DriveFault(DriveCode.TABLE_TOO_LARGE, f"at most {MOST_TABLE_BYTES} bytes")))
        else:
            found = await asyncio.to_thread(downloaded, self._station, data, self._load)
            self._set(found.station)
            await self._keep_now()
            client.writer.write(found.reply)
        return True

    async def _table(self, client: _Client, count: int) -> bytes | None:
        """Return the lines of a table, with LF at their ends; None if they do not come. Of too many not all are kept.

        The lines of a client that may not download are read as well: its next request comes after them.
        """
        lines, size = [], 0
        for _ in range(count):
            try:
                async with asyncio.timeout(self._patience.download_s):
                    line = await client.lines.next()
            except TimeoutError:
                return None
            if line is None:
                return None
            size += len(line) + 1
            if size <= MOST_TABLE_BYTES + LONGEST_TABLE_LINE and self._barred(client).host is None:
                lines.append(line)
        return b"".join(line + b"\n" for line in lines)

    async def _let_read(self, client: _Client) -> None:
        """Wait for a client that has not read its replies; not for ever."""
        if client.writer.transport.get_write_buffer_size() > LARGEST_BACKLOG:
            async with asyncio.timeout(self._patience.reading_s):
                await client.writer.drain()

    def _seen(self) -> Station:
        """Return the station as it shows now."""
        if self._pace is None:
            return self._station
        seen = on_the_way(self._pace, self._travel, self._station.state, time.monotonic())
        return replace(self._station, on_the_way=seen)

    def _set(self, station: Station) -> None:
        if station.state.plates != self._station.state.plates:
            self._travel = Travel(self._seen().shown.plates, time.monotonic())
        self._station = station

    def _barred(self, client: _Client) -> Barred:
        """Return what a client may not do."""
        if self._host is client:
            return Barred()
        other = self._other_operator(client)
        fault = None if other is None else busy(other)
        return Barred(fault, fault if self._host is None else hosted(self._host.address))

    def _other_operator(self, client: _Client) -> str | None:
        """Return the address of the operator if that is not this client; without an operator nobody may change."""
        if client in (self._operator, self._host):
            return None
        return self._operator.address if self._operator is not None else NOBODY

    async def _keep_from_time_to_time(self) -> None:
        while self._keep is not None:
            await asyncio.sleep(KEEP_PAUSE_S)
            await self._keep_now()

    async def _keep_now(self) -> None:
        async with self._keeping:
            station = self._station
            changed = station.table is not self._kept.table or station.mark != self._kept.mark
            if self._keep is not None and changed:
                await asyncio.to_thread(self._keep, station)
                self._kept = station

    async def _dismiss(self) -> None:
        """End all connections, including those that do not read their replies."""
        for client in self._clients:
            client.writer.close()
        tasks = [task for task in self._clients.values() if task is not None]
        if tasks:
            await asyncio.wait(tasks, timeout=self._patience.ending_s)
        for client in self._clients:
            client.writer.transport.abort()
        if tasks:
            await asyncio.wait(tasks)


def _door(token: str, patience: Patience) -> Door:
    text = "that is not the token which 'orip drive emulate' has printed; it is said in the first line: TOKEN ..."
    return Door(lambda line: shows_token(line, token), error(DriveFault(DriveCode.FORBIDDEN, text)), patience.token_s)


def _address(writer: asyncio.StreamWriter) -> str:
    peer = writer.get_extra_info("peername")
    if peer is None:  # gone before it was greeted
        return "unknown"
    host, port = peer[:2]
    return f"[{host}]:{port}" if ":" in host else f"{host}:{port}"
