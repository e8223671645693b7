"""Who may use what orip serves: whoever says the token of the run; and addresses to listen on."""

from __future__ import annotations

import asyncio
import hashlib
import ipaddress
import os
import platform
import re
import secrets
import socket
import stat
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, suppress
from pathlib import Path

from msgspec import Struct, field

from orip.errors import UsageError

# (greeting)      OK KDPP-EMU 1 TOKEN         of the plate processor; of `orip online` {"wants": "token"}
#     TOKEN t         the greeting of everybody else, or ERR 403 text, and the connection ends
#
# Every account of a machine can connect to its loopback interface, and so can every page of the web that a browser
# shows there. The token keeps both out; it does not keep others from listening: nothing on the line is encrypted.
#
# The token of a plate processor is in a file that nobody but the user reads, for as long as it is served, so that
# orip's own commands find it where they run on the same machine.

ASKING = "OK KDPP-EMU 1 TOKEN"
"""What is said first where a token is wanted."""

MOST_CLIENTS = 64
"""Connections that are served at a time."""

MOST_WAITING = 32
"""Connections that have not said the token yet; with more the one that has waited longest ends."""

_LONGEST_FIRST_LINE = 512
_HANGING_UP_S = 1.0
_TOKEN = re.compile(r"[A-Za-z0-9_-]{1,100}")
_URL = re.compile(r"http://[0-9a-z.:\[\]]{1,60}/[A-Za-z0-9_-]{1,100}/")
_HTTP = re.compile(
    rb"(?i)\s*(?:\S+\s.*\bHTTP/[0-9]|(?:GET|HEAD|POST|PUT|DELETE|CONNECT|OPTIONS|TRACE|PATCH|PRI)\b|[\w-]+:)"
)


def new_token() -> str:
    """Return a token that nobody can guess, of letters, digits, '-' and '_'."""
    return secrets.token_urlsafe(16)


def is_token(given: bytes, token: str) -> bool:
    """Compare with the token; how long that takes does not depend on how much of it is right."""
    return secrets.compare_digest(given.strip(), token.encode("ascii"))


def shows_token(line: bytes, token: str) -> bool:
    """Tell whether a request to a plate processor is the right token."""
    verb, _, given = line.strip().partition(b" ")
    return is_token(given, token) and verb.upper() == b"TOKEN"


def is_of_browser(line: bytes) -> bool:
    """Tell whether a line is one that a browser sends: of a request, or of its head."""
    return _HTTP.match(line) is not None


class Door(Struct, eq=False):
    """Where connections wait until they have said the token: not for long, and not many of them.

    Parameters
    ----------
    shows : function of a line
        Tells whether it is the token.
    refusal : bytes
        What is said to others.
    patience_s : float
        Seconds to wait for it.
    """

    shows: Callable[[bytes], bool]
    refusal: bytes
    patience_s: float
    waiting: dict[asyncio.StreamWriter, None] = field(default_factory=dict)

    async def lets_in(self, stream: asyncio.StreamReader, writer: asyncio.StreamWriter) -> bool:
        """Tell whether a connection says the token in its first line; one that does not is ended.

        Raises
        ------
        OSError
            If nothing is said in time, or the connection is lost.
        """
        self.waiting[writer] = None
        if len(self.waiting) > MOST_WAITING:
            longest = next(iter(self.waiting))
            del self.waiting[longest]
            longest.transport.abort()
        try:
            async with asyncio.timeout(self.patience_s):
                line = await _first_line(stream)
            if line is not None and self.shows(line):
                return True
            writer.write(self.refusal)
            await hang_up(stream, writer)
        finally:
            self.waiting.pop(writer, None)
        return False


async def _first_line(stream: asyncio.StreamReader) -> bytes | None:
    """Return the first line; None where it is too long, or is none of text: nothing after it is looked at."""
    line = b""
    while len(line) <= _LONGEST_FIRST_LINE:
        character = await stream.read(1)
        if character == b"\n":
            return line
        if not b" " <= character <= b"~" and character not in {b"\r", b"\t"}:
            return None
        line += character
    return None


async def hang_up(stream: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    """End a connection so that what was said last arrives: what still comes is taken in for a while."""
    with suppress(OSError, RuntimeError):  # lost, or nothing more can be written
        async with asyncio.timeout(_HANGING_UP_S):
            await writer.drain()
            writer.write_eof()
            while await stream.read(1 << 16):
                pass
    writer.close()


def token_kept(host: str, port: int, token: str) -> AbstractContextManager[None]:
    """Keep a token meanwhile where this user's programs on this machine find it; nowhere if there is no such place."""
    return _kept(f"{host}-{port}", token, _TOKEN)


def stored_token(host: str, port: int) -> str | None:
    """Return the token that a program of this user's listens with at an address of this machine; None without one."""
    return _stored(f"{host}-{port}", _TOKEN)


def page_kept(folder: Path, url: str) -> AbstractContextManager[None]:
    """Keep the address of the page that is served of a folder meanwhile, as `token_kept` does a token."""
    return _kept(_of_folder(folder), url, _URL)


def stored_page(folder: Path) -> str | None:
    """Return the address of the page that a program of this user's serves of a folder; None without one."""
    return _stored(_of_folder(folder), _URL)


def _of_folder(folder: Path) -> str:
    whole = str(folder.resolve()).encode(errors="surrogateescape")
    return f"screen-{hashlib.blake2b(whole, digest_size=12).hexdigest()}"


@contextmanager
def _kept(of: str, text: str, form: re.Pattern[str]) -> Iterator[None]:
    path = None
    with suppress(OSError, RuntimeError):  # without a home, for example
        path = private_file(_name(of), text)
    try:
        yield
    finally:
        if path is not None and _stored(of, form) == text:
            with suppress(OSError):
                path.unlink()


def _stored(of: str, form: re.Pattern[str]) -> str | None:
    try:
        path = _private_folder() / _name(of)
        descriptor = os.open(path, os.O_RDONLY | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0))
        with os.fdopen(descriptor, "rb") as file:
            text = file.read(200).decode("ascii", errors="replace")
    except (OSError, RuntimeError):
        return None
    return text if form.fullmatch(text) else None


def private_file(name: str, text: str) -> Path:
    """Write a file that nobody else can read, and return its path.

    Raises
    ------
    OSError, RuntimeError
        If there is no place for it.
    """
    path = _private_folder() / name
    made = path.with_name(f"{name}.{secrets.token_hex(4)}")
    with os.fdopen(os.open(made, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w", encoding="utf-8") as file:
        file.write(text)
    made.replace(path)
    return path


def _private_folder() -> Path:
    """Return the folder of what nobody else may read; it is made where it is missing."""
    given = os.environ.get("XDG_RUNTIME_DIR" if os.name == "posix" else "LOCALAPPDATA")
    within = Path(given) if given and _is_own(Path(given)) else Path.home() / ".local" / "state"
    folder = within / "orip"
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    if not _is_own(folder) or (os.name == "posix" and folder.lstat().st_mode & 0o077):
        raise PermissionError
    return folder


def _is_own(folder: Path) -> bool:
    """Tell whether a folder is there, no link, and this user's."""
    with suppress(OSError):
        status = folder.lstat()
        return stat.S_ISDIR(status.st_mode) and (os.name != "posix" or status.st_uid == os.geteuid())
    return False


def _name(of: str) -> str:
    """Return the name of a file that is of this machine: homes may be shared by several."""
    return re.sub(r"[^\w.-]", "_", f"{platform.node()}-{of}")


def listening_address(text: str, otherwise: str | None) -> tuple[str, int]:
    """Return address and port of ``host:port``; port 0: any that is free.

    Parameters
    ----------
    otherwise : str or None
        What to do, besides listening on 127.0.0.1, where other machines could reach the address; None: they may.

    Raises
    ------
    UsageError
        If it is no such address, or other machines could reach it and must not.
    """
    host, _, port = text.rpartition(":")
    host = host.removeprefix("[").removesuffix("]")
    if not host or not (port.isascii() and port.isdecimal() and int(port) <= 65535):
        message = f"'{text}' is not an address to listen on; write HOST:PORT, for example 127.0.0.1:4788"
        raise UsageError(message)
    try:
        found = socket.getaddrinfo(host, int(port), type=socket.SOCK_STREAM)
    except (OSError, UnicodeError) as error:
        message = f"the host of '{text}' is not known; write for example 127.0.0.1:4788"
        raise UsageError(message) from error
    address = str(found[0][4][0])
    if otherwise is not None and not ipaddress.ip_address(address.partition("%")[0]).is_loopback:
        message = f"{text} can be reached from other machines; listen on 127.0.0.1{otherwise}"
        raise UsageError(message)
    return address, int(port)
