"""The server of the pages of `orip drive watch`, `orip online` and `orip screen`, on the loopback interface.

    GET  /TOKEN/          the page
    GET  /TOKEN/scene     what stays
    GET  /TOKEN/events    what moves, as server-sent events
    GET  /TOKEN/pictures/NAME      a picture, JPEG
    GET  /TOKEN/PAGE      a further page
    POST /TOKEN/COMMAND            what the page asks for, one JSON object

Any page of the web can send requests to the loopback interface. So the address has a token that nobody else knows;
requests under any other name of this machine are refused (a name of the web can be made to point here), and commands
have to be JSON, which browsers do not send to another origin unasked.
"""

from __future__ import annotations

import json
import secrets
import socket
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler
from importlib.resources.abc import Traversable
from socketserver import ThreadingTCPServer
from types import MappingProxyType
from typing import Any, Protocol
from urllib.parse import urlsplit

from orip.errors import OripError

Document = dict[str, Any]
"""JSON."""

HOST = "127.0.0.1"

IDLE_S = 30.0
"""A connection on which nothing is asked, or nothing is read, for this long is ended."""

LONGEST_REQUEST = 4096
MOST_STREAMS = 64
MOST_CONNECTIONS = 128

_HTML = "text/html; charset=utf-8"
_PICTURES = "pictures/"
_TICK_S = 0.05
_SIGN_OF_LIFE_S = 5.0
"""A stream on which nothing moves says so: only what is sent shows that nobody is there any more."""

_POLICY = (
    "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data: blob:; "
    "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)


NO_PAGES: Mapping[str, Callable[[], str]] = MappingProxyType({})


class RequestError(OripError):
    """What a page asks for cannot be understood."""


def no_pictures(name: str) -> bytes:
    """Serve a page that has no pictures."""
    message = f"there is no picture {name[:60]!a}"
    raise RequestError(message)


class Watched(Protocol):
    """What a page shows, as JSON documents; called from several threads at once.

    Attributes
    ----------
    page : Traversable
        The page, a file of a package.
    scene : document
        What stays.
    commands : mapping
        What can be asked for, by the words of the requests.
    """

    page: Traversable
    scene: Document
    commands: Mapping[str, Callable[[Document], Document]]

    def state(self) -> Document:
        """Return what moves; `serial` counts up whenever anything has changed."""


class WatchServer(ThreadingTCPServer):
    """Serves a page, each connection in a thread of its own.

    Parameters
    ----------
    address : tuple (host, port)
        An address of this machine that no other one reaches; port 0: any that is free.
    pictures : function of a name
        Returns a picture as JPEG, or raises an OripError; called from several threads at once.
    pages : mapping of str to function
        Further pages, HTML that is made when it is asked for; called from several threads at once.

    Raises
    ------
    OSError
        If the address is taken.
    """

    allow_reuse_address = True
    daemon_threads = True
    request_queue_size = 64

    def __init__(
        self,
        watch: Watched,
        address: tuple[str, int] = (HOST, 0),
        pictures: Callable[[str], bytes] = no_pictures,
        pages: Mapping[str, Callable[[], str]] = NO_PAGES,
    ) -> None:
        self.watch, self.pictures, self.pages = watch, pictures, pages
        self.token, self.shows = secrets.token_urlsafe(16), ""
        self.page = watch.page.read_bytes()
        self.scene = _json(watch.scene)
        self.ending = threading.Event()
        self.streams = threading.BoundedSemaphore(MOST_STREAMS)
        self._free = threading.BoundedSemaphore(MOST_CONNECTIONS)
        self.address_family = socket.AF_INET6 if ":" in address[0] else socket.AF_INET
        super().__init__(address, _Handler)

    @property
    def host(self) -> str:
        """Return the host as it stands in a URL."""
        host = str(self.server_address[0])
        return f"[{host}]" if ":" in host else host

    @property
    def port(self) -> int:
        """Return the port."""
        return int(self.server_address[1])

    @property
    def url(self) -> str:
        """Return the address of the page, and what it is to show first (`shows`, behind a ``#``)."""
        return f"http://{self.host}:{self.port}/{self.token}/{self.shows and '#'}{self.shows}"

    def process_request(self, request: Any, client_address: Any) -> None:
        """Serve a connection in a thread, if there are not too many."""
        if self._free.acquire(blocking=False):
            super().process_request(request, client_address)
        else:
            self.shutdown_request(request)

    def process_request_thread(self, request: Any, client_address: Any) -> None:
        """Serve a connection to its end."""
        try:
            super().process_request_thread(request, client_address)
        finally:
            self._free.release()

    def server_close(self) -> None:
        """End: streams too."""
        self.ending.set()
        super().server_close()

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Say nothing: a browser that hangs up is no error, and there is nobody else."""


class _Handler(BaseHTTPRequestHandler):
    """One connection."""

    server: WatchServer
    protocol_version = "HTTP/1.1"
    server_version, sys_version = "orip", ""
    timeout = IDLE_S
    disable_nagle_algorithm = True

    def do_GET(self) -> None:  # the name that http.server looks for
        """Send the page, what it shows, or what moves."""
        path = self._asked_for()
        if path == "":
            self._send(HTTPStatus.OK, _HTML, self.server.page)
        elif path is not None and path in self.server.pages:
            self._send(HTTPStatus.OK, _HTML, self.server.pages[path]().encode())
        elif path == "scene":
            self._send(HTTPStatus.OK, "application/json", self.server.scene)
        elif path == "events":
            self._stream()
        elif path is not None and path.startswith(_PICTURES):
            self._send_picture(path.removeprefix(_PICTURES))
        elif path is not None:
            self._refuse(HTTPStatus.NOT_FOUND, "there is nothing here")

    def do_POST(self) -> None:
        """Do what is asked for."""
        path = self._asked_for()
        if path is None:
            return
        command, body = self.server.watch.commands.get(path), self._body()
        if body is None:
            return
        if command is None:
            self._refuse(HTTPStatus.NOT_FOUND, "there is no such command")
            return
        try:
            reply = command(_request(body))
        except OripError as error:
            self._refuse(HTTPStatus.BAD_REQUEST, str(error))
        else:
            self._send(HTTPStatus.OK, "application/json", _json(reply))

    def _send_picture(self, name: str) -> None:
        try:
            picture = self.server.pictures(name)
        except OripError as error:
            self._refuse(HTTPStatus.NOT_FOUND, str(error))
        else:
            self._send(HTTPStatus.OK, "image/jpeg", picture)

    def log_message(self, *_: object) -> None:
        """Say nothing of requests."""

    def send_error(self, code: int, message: str | None = None, explain: str | None = None) -> None:
        """Send what http.server finds wrong."""
        self._refuse(HTTPStatus(code), explain or message or HTTPStatus(code).phrase)

    def _asked_for(self) -> str | None:
        """Return the path after the token; None: the request is not for here, and that has been said."""
        here = {f"{name}:{self.server.port}" for name in (self.server.host, "localhost")}
        origin = self.headers.get("Origin")
        if self.headers.get("Host") not in here or (origin is not None and origin not in {f"http://{n}" for n in here}):
            self._refuse(HTTPStatus.FORBIDDEN, "this page is for the browser of this machine")
            return None
        token, slash, path = urlsplit(self.path).path.removeprefix("/").partition("/")
        if not (slash and secrets.compare_digest(token.encode(), self.server.token.encode())):
            self._refuse(HTTPStatus.FORBIDDEN, "take the address that was printed when the page was begun")
            return None
        return path

    def _body(self) -> bytes | None:
        """Return the body of a command; None: there is none that could be, and that has been said."""
        length = self.headers.get("Content-Length", "")
        if self.headers.get_content_type() != "application/json":
            self._refuse(HTTPStatus.UNSUPPORTED_MEDIA_TYPE, "commands are JSON")
        elif not length.isdecimal():
            self._refuse(HTTPStatus.LENGTH_REQUIRED, "commands have a Content-Length")
        elif int(length[:10]) > LONGEST_REQUEST:
            self._refuse(HTTPStatus.REQUEST_ENTITY_TOO_LARGE, f"commands have up to {LONGEST_REQUEST} bytes")
        else:
            return self.rfile.read(int(length))
        return None

    def _stream(self) -> None:
        """Send the state whenever it has changed, until the browser leaves or the server ends."""
        server = self.server
        if not server.streams.acquire(blocking=False):
            self._refuse(HTTPStatus.SERVICE_UNAVAILABLE, f"{MOST_STREAMS} pages are open; close one")
            return
        try:
            self.close_connection = True
            self._head(HTTPStatus.OK, "text/event-stream")
            self.end_headers()
            serial, said_at = None, time.monotonic()
            while not server.ending.is_set():
                state, now = server.watch.state(), time.monotonic()
                if state["serial"] != serial:
                    self.wfile.write(b"data: " + _json(state) + b"\n\n")
                    serial, said_at = state["serial"], now
                elif now > said_at + _SIGN_OF_LIFE_S:
                    self.wfile.write(b":\n\n")
                    said_at = now
                server.ending.wait(_TICK_S)
        except OSError:
            pass  # the browser has left
        finally:
            server.streams.release()

    def _refuse(self, status: HTTPStatus, text: str) -> None:
        """Send an error; what may be left of the request is not looked at."""
        self.close_connection = True
        self._send(status, "application/json", _json({"error": text}))

    def _send(self, status: HTTPStatus, content_type: str, body: bytes) -> None:
        self._head(status, content_type)
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        if self.command != "HEAD":
            self.wfile.write(body)

    def _head(self, status: HTTPStatus, content_type: str) -> None:
        self.send_response(status)
        self.send_header("Content-Type", content_type)
        self.send_header("Cache-Control", "no-store")
        self.send_header("Content-Security-Policy", _POLICY)
        self.send_header("Cross-Origin-Resource-Policy", "same-origin")
        self.send_header("Referrer-Policy", "no-referrer")
        self.send_header("X-Content-Type-Options", "nosniff")
        if self.close_connection:
            self.send_header("Connection", "close")


def _request(body: bytes) -> Document:
    try:
        request = json.loads(body)
    except (ValueError, RecursionError):
        request = None
    if not isinstance(request, dict):
        message = "a command is one JSON object"
        raise RequestError(message)
    return request


def _json(document: Document) -> bytes:
    return json.dumps(document, allow_nan=False, separators=(",", ":")).encode()


def word(asked: Document, key: str) -> str:
    """Return a name; raise a `RequestError` if it is missing."""
    found = asked.get(key)
    if not isinstance(found, str) or not found:
        message = f"'{key}' is missing: give its name"
        raise RequestError(message)
    return found


def one_of(asked: Document, key: str, allowed: Sequence[str]) -> Any:
    """Return one of the words that are allowed; raise a `RequestError` if it is another one."""
    found = asked.get(key)
    if found not in allowed:
        message = f"'{key}' is one of {', '.join(allowed)}"
        raise RequestError(message)
    return found


def number(given: object, most: float) -> float:
    """Return a number; raise a `RequestError` if it is none, or its size is above `most`."""
    if isinstance(given, bool) or not isinstance(given, int | float) or not abs(given) <= most:
        message = f"expected a number up to {most:g}"
        raise RequestError(message)
    return float(given)


def numbers(given: object, count: int, most: float, what: str) -> tuple[float, ...]:
    """Return so many numbers; raise a `RequestError` if these are others."""
    if not isinstance(given, list) or len(given) != count:
        message = f"{what} are {count} numbers"
        raise RequestError(message)
    return tuple(number(one, most) for one in given)
