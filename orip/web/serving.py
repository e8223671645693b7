"""A page that is served until Ctrl-C and opened in the browser, or in a thread while something else is done."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, nullcontext
from html import escape

from orip.errors import OripError
from orip.threads import begin_thread
from orip.web import ANY_PORT
from orip.web.page_server import NO_PAGES, Watched, WatchServer, no_pictures


def page_server(
    watch: Watched,
    address: tuple[str, int],
    pictures: Callable[[str], bytes] = no_pictures,
    pages: Mapping[str, Callable[[], str]] = NO_PAGES,
) -> WatchServer:
    """Return the server of a page.

    Raises
    ------
    OripError
        If the address is taken.
    """
    try:
        return WatchServer(watch, address, pictures, pages)
    except OSError as error:
        host, port = address
        why = error.strerror or error
        message = (
            f"port {port} of {host} cannot be taken ({why}); choose another; any that is free: --listen {ANY_PORT}"
        )
        raise OripError(message) from error


@contextmanager
def served_meanwhile(watch: Watched) -> Iterator[str]:
    """Serve a page in a thread of its own meanwhile; give its address."""
    server = WatchServer(watch)
    begin_thread(server.serve_forever, "the page")
    try:
        yield server.url
    finally:
        server.shutdown()
        server.server_close()


@contextmanager
def _page_to_open(server: WatchServer) -> Iterator[str]:
    """Yield what a browser is given to open: others can see its command, and could drive and measure by the token."""
    from orip.web.access import private_file

    url = escape(server.url)
    page = f'<!doctype html><meta http-equiv="refresh" content="0; url={url}"><a href="{url}">orip</a>'
    try:
        path = private_file(f"page-{server.port}.html", page)
    except (OSError, RuntimeError):
        yield server.url.replace(f"{server.token}/", "")  # tells to take the address that was printed
        return
    try:
        yield path.as_uri()
    finally:
        path.unlink(missing_ok=True)


def serve_until_ended(server: WatchServer, *, browser: bool) -> None:
    """Serve until Ctrl-C or SIGTERM, which are the way to end and no error."""
    import webbrowser

    before = signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        with _page_to_open(server) if browser else nullcontext() as page:
            if page is not None:
                # one that runs in this terminal comes back only when it is left
                threading.Thread(target=webbrowser.open, args=(page,), daemon=True).start()
            server.serve_forever(poll_interval=0.1)
    except KeyboardInterrupt:
        pass
    finally:
        signal.signal(signal.SIGTERM, before)
