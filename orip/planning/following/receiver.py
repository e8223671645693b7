"""What a GNSS receiver says while it flies: lines of NMEA 0183 from a file, a serial line, or TCP."""

from __future__ import annotations

import os
import re
import socket
import stat
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Protocol
from urllib.parse import urlsplit

from msgspec import Struct

from orip.errors import OripError, UsageError

_LONGEST = 1024
"""Bytes of a line: NMEA has 82, and what is longer is no text."""

_NUMBER = re.compile(r"[0-9]+(\.[0-9]*)?")


class Fix(Struct, frozen=True):
    """A position.

    Parameters
    ----------
    longitude, latitude : float
        Degrees.
    height : float
        Above mean sea level, metres.
    separation : float
        Of mean sea level from the ellipsoid, metres; NaN where it is not said.
    quality : int
        1: alone, 2: differential, 4: RTK fixed, 5: RTK float.
    """

    longitude: float
    latitude: float
    height: float
    separation: float
    quality: int


def read_fix(line: str) -> Fix | None:
    """Return the position of a GGA sentence; None of other sentences, and where there is no position yet.

    Raises
    ------
    ValueError
        If it is a sentence whose sum or fields are wrong.
    """
    text = line.strip()
    if not text.startswith("$"):
        return None
    body, star, given = text[1:].partition("*")
    if star and (len(given) < 2 or f"{_sum_of(body):02X}" != given[:2].upper()):
        message = "the check sum is wrong"
        raise ValueError(message)
    fields = body.split(",")
    if not fields[0].endswith("GGA"):
        return None
    if len(fields) < 12:
        message = "GGA has fewer than 12 fields"
        raise ValueError(message)
    if fields[6] in {"", "0"}:
        return None
    latitude = _degrees(fields[2], fields[3], "NS", 2)
    longitude = _degrees(fields[4], fields[5], "EW", 3)
    return Fix(longitude, latitude, float(fields[9]), float(fields[11] or "nan"), int(fields[6]))


def _sum_of(body: str) -> int:
    found = 0
    for character in body:
        found ^= ord(character)
    return found


def _degrees(value: str, letter: str, letters: str, whole: int) -> float:
    if not _NUMBER.fullmatch(value) or letter not in letters or not letter:
        message = f"'{value},{letter}' is no {'latitude' if whole == 2 else 'longitude'}"
        raise ValueError(message)
    degrees = int(value[:whole]) + float(value[whole:]) / 60.0
    return degrees if letter == letters[0] else -degrees


@contextmanager
def lines_of(source: str, folder: Path, baud: int) -> Iterator[Iterator[str]]:
    """Give the lines of a file, - (standard input), tcp://HOST:PORT, or a serial device such as /dev/ttyUSB0.

    Raises
    ------
    UsageError
        If there is no such source.
    OripError
        If it cannot be read.
    """
    if source == "-":
        yield _decoded(sys.stdin.buffer)
        return
    if source.startswith("tcp://"):
        with _connected(source) as connection, connection.makefile("rb") as stream:
            yield _decoded(stream)
        return
    path = folder / source
    try:
        mode = path.stat().st_mode
        if not (stat.S_ISREG(mode) or stat.S_ISCHR(mode)):
            message = f"{source} is neither a file nor a serial device"
            raise UsageError(message)
        with path.open("rb", buffering=0 if stat.S_ISCHR(mode) else -1) as stream:
            if stat.S_ISCHR(mode):
                _set_line(stream.fileno(), source, baud)
            yield _decoded(stream)
    except FileNotFoundError as error:
        message = f"there is no {source}; name a file, -, tcp://HOST:PORT, or a serial device"
        raise UsageError(message) from error
    except OSError as error:
        message = f"{source} cannot be read: {error.strerror or error}"
        raise OripError(message) from error


class _Lines(Protocol):
    def readline(self, longest: int, /) -> bytes: ...


def _decoded(stream: _Lines) -> Iterator[str]:
    """Yield lines as text; a serial device ends where it is unplugged."""
    with suppress(OSError):
        while line := stream.readline(_LONGEST):
            yield line.decode("ascii", errors="replace")


def _connected(source: str) -> socket.socket:
    try:
        parts = urlsplit(source)
        host, port = parts.hostname, parts.port
    except ValueError:
        host, port = None, None
    if host is None or port is None:
        message = f"'{source}' is no address; write tcp://HOST:PORT"
        raise UsageError(message)
    try:
        return socket.create_connection((host, port), timeout=None)
    except OSError as error:
        message = f"{source} does not answer: {error.strerror or error}"
        raise OripError(message) from error


def _set_line(descriptor: int, source: str, baud: int) -> None:
    """Set a serial line to a speed, eight bits, and bytes as they are.

    Raises
    ------
    UsageError
        If this system has no such way, or the line no such speed.
    """
    try:
        import termios
        import tty
    except ImportError as error:
        message = f"serial lines cannot be read here; send what {source} says to TCP, and name tcp://HOST:PORT"
        raise UsageError(message) from error
    if not os.isatty(descriptor):
        return
    speed = getattr(termios, f"B{baud}", None)
    if speed is None:
        message = f"a serial line has no speed of {baud} baud; usual ones are 4800, 9600, 38400, 115200"
        raise UsageError(message)
    tty.setraw(descriptor)
    settings = termios.tcgetattr(descriptor)
    settings[4] = settings[5] = speed
    termios.tcsetattr(descriptor, termios.TCSANOW, settings)
