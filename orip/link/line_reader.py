"""Lines that a client sends, of whatever length, at whatever speed, in bounded memory."""

from __future__ import annotations

import asyncio

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
