"""The line between host and plate processor: a TCP connection, or a serial line through pyserial."""

from __future__ import annotations

import importlib
import re
import socket
import time
from typing import Any, Protocol

from orip.errors import LinkError
from orip.web.access import ASKING, stored_token

LONGEST_REPLY = 4096
"""Bytes; a plate processor's longest line has some 200."""

_TCP = re.compile(r"tcp://(?:([A-Za-z0-9_-]{1,100})@)?(?:\[([0-9A-Fa-f:.]+)\]|([^/:\[\]]+)):([0-9]{1,5})/?")

_QUIET_S = 0.2
"""A serial line on which nothing came for this long has nothing left from before."""


class LinkLine(Protocol):
    """A line that requests go out on and replies come in on."""

    def send(self, data: bytes, timeout_s: float | None = None) -> None:
        """Send bytes; `LinkError` if the other side does not take them in time."""

    def receive(self, timeout_s: float | None = None) -> str:
        """Return the next line without its end; `LinkError` if it does not come in time."""

    def close(self) -> None:
        """End the connection."""


def open_line(url: str, timeout_s: float) -> tuple[LinkLine, str]:
    """Open a line and return it with the plate processor's greeting.

    Raises
    ------
    ConnectionError
        If nobody is there: it may help to try again.
    LinkError
        If the URL cannot be used, or who is there says nothing.
    """
    if not url.lower().startswith("tcp:"):
        return _open_serial(url, timeout_s)
    found = _TCP.fullmatch(url)
    if found is None or int(found[4]) > 65535:
        message = f"'{url}' is not a link; write for example tcp://127.0.0.1:4788"
        raise LinkError(message)
    line = SocketLine(found[2] or found[3], int(found[4]), without_token(url), timeout_s)
    first = line.greeting()
    return line, first if first != ASKING else _let_in(line, found[1], without_token(url))


def without_token(url: str) -> str:
    """Return a URL as it may be shown."""
    return re.sub(r"^(tcp://)[^@/]*@", r"\1", url)


def _let_in(line: SocketLine, token: str | None, url: str) -> str:
    """Show the token of the URL, else that of a program of this user's, and return the greeting that follows."""
    token = token or stored_token(*line.peer)
    if token is not None:
        line.send(f"TOKEN {token}\n".encode("ascii"))
        first = line.greeting()
        if not first.startswith("ERR 403"):
            return first
    line.close()
    what = "wants a token" if token is None else "does not take this token (error 403)"
    message = (
        f"the plate processor at {url} {what}; give the link as 'orip drive emulate' has printed it, "
        "tcp://TOKEN@HOST:PORT, best in ORIP_LINK: others can see words of a command"
    )
    raise LinkError(message)


class SocketLine:
    """A TCP connection."""

    def __init__(self, host: str, port: int, url: str, timeout_s: float) -> None:
        self._url, self._timeout_s, self._received = url, timeout_s, b""
        try:
            self._socket = socket.create_connection((host, port), timeout_s)
        except OSError as error:
            raise ConnectionError(error.strerror or str(error)) from error
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    @property
    def peer(self) -> tuple[str, int]:
        """Return the address and port that this is connected to."""
        host, port = self._socket.getpeername()[:2]
        return host, port

    def greeting(self) -> str:
        """Return the first line."""
        try:
            return self.receive()
        except BaseException:
            self.close()
            raise

    def send(self, data: bytes, timeout_s: float | None = None) -> None:
        """Send bytes."""
        try:
            self._socket.settimeout(self._timeout_s if timeout_s is None else timeout_s)
            self._socket.sendall(data)
        except OSError as error:
            raise self._broken(error) from error

    def receive(self, timeout_s: float | None = None) -> str:
        """Return the next line."""
        deadline = time.monotonic() + (self._timeout_s if timeout_s is None else timeout_s)
        while b"\n" not in self._received:
            if len(self._received) > LONGEST_REPLY:
                message = (
                    f"what answers at {self._url} is not a plate processor: it sends lines without end; check --link"
                )
                raise LinkError(message)
            self._received += self._more(deadline)
        line, _, self._received = self._received.partition(b"\n")
        return _shown(line)

    def close(self) -> None:
        """End the connection."""
        self._socket.close()

    def _more(self, deadline: float) -> bytes:
        remaining = deadline - time.monotonic()
        try:
            if remaining <= 0.0:
                raise TimeoutError
            self._socket.settimeout(remaining)
            data = self._socket.recv(65536)
        except OSError as error:
            raise self._broken(error) from error
        if not data:
            message = f"the plate processor at {self._url} has ended the connection; see what it says, and try again"
            raise LinkError(message)
        return data

    def _broken(self, error: OSError) -> LinkError:
        if isinstance(error, TimeoutError):
            return no_answer(self._url)
        return LinkError(f"the connection to {self._url} broke off ({error.strerror or error}); try again")


class SerialLine:
    """A serial line; the port is one of pyserial's."""

    def __init__(self, port: Any, url: str, timeout_s: float) -> None:
        self._port, self._url, self._timeout_s = port, url, timeout_s

    def greeting(self) -> str:
        """Leave behind what may be on the line from before, and ask who is there."""
        try:
            self.send(b"\n")  # ends what may have been sent in part
            self._port.timeout = _QUIET_S
            deadline = time.monotonic() + self._timeout_s
            while self._port.read(LONGEST_REPLY) and time.monotonic() < deadline:
                pass
            self.send(b"VERSION\n")
            return self.receive()
        except OSError as error:
            raise LinkError(self._broken(error)) from error
        except BaseException:
            self.close()
            raise

    def send(self, data: bytes, timeout_s: float | None = None) -> None:
        """Send bytes."""
        try:
            self._port.write_timeout = self._timeout_s if timeout_s is None else timeout_s
            self._port.write(data)
            self._port.flush()
        except OSError as error:  # pyserial's errors are of this class
            raise LinkError(self._broken(error)) from error

    def receive(self, timeout_s: float | None = None) -> str:
        """Return the next line."""
        try:
            self._port.timeout = self._timeout_s if timeout_s is None else timeout_s
            line: bytes = self._port.read_until(b"\n", LONGEST_REPLY)
        except OSError as error:
            raise LinkError(self._broken(error)) from error
        if not line.endswith(b"\n"):
            raise no_answer(self._url)
        return _shown(line[:-1])

    def close(self) -> None:
        """Close the port."""
        self._port.close()

    def _broken(self, error: OSError) -> str:
        return f"the serial line {self._url} broke off ({error}); check the cable, and try again"


def _shown(line: bytes) -> str:
    """Return the text of a reply, which may be shown: characters that steer terminals are written as escapes."""
    text = line.decode("ascii", errors="replace").removesuffix("\r")
    if text.isascii() and text.isprintable():
        return text
    return "".join(one if " " <= one <= "~" else one.encode("unicode_escape").decode("ascii") for one in text)


def no_answer(url: str) -> LinkError:
    """Return the error of a time-out."""
    return LinkError(f"what is at {url} does not answer in time; is it a plate processor, and is it free?")


def _open_serial(url: str, timeout_s: float) -> tuple[LinkLine, str]:
    try:
        serial = importlib.import_module("serial")
    except ImportError:
        message = (
            f"'{url}' would be a serial line, which needs pyserial: install it with pip install 'orip[serial]'; "
            "a link over the network is written tcp://host:port"
        )
        raise LinkError(message) from None
    try:
        port = serial.serial_for_url(url, timeout=timeout_s, write_timeout=timeout_s)
    except ValueError as error:
        message = f"'{url}' is not a link ({error}); write for example tcp://127.0.0.1:4788 or /dev/ttyS0"
        raise LinkError(message) from error
    except OSError as error:
        raise ConnectionError(str(error)) from error
    line = SerialLine(port, url, timeout_s)
    return line, line.greeting()
