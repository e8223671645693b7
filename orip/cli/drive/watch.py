"""`orip drive watch`."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from typing import TYPE_CHECKING, Annotated

import typer

from orip.cli.drive.commands import drive
from orip.cli.options import LINK_VARIABLE, BundleArgument, Invocation, command
from orip.errors import OripError

if TYPE_CHECKING:
    from orip.link.watch import Watch
    from orip.link.watch_server import WatchServer

Link = Annotated[
    str | None,
    typer.Option(
        "--link",
        envvar=LINK_VARIABLE,
        metavar="URL",
        help="Show this plate processor, for example tcp://127.0.0.1:4788.",
    ),
]
Listen = Annotated[
    str,
    typer.Option(
        "--listen", metavar="HOST:PORT", help="Where the page is served, on this machine. Port 0: any that is free."
    ),
]
ANY_PORT = "127.0.0.1:0"
Open = Annotated[bool, typer.Option("--open/--no-open", help="Open the page in the browser.")]


def register(_app: typer.Typer) -> None:
    """Add the command to the group `orip drive`."""
    command(drive, "watch")(watch_command)


def watch_command(
    invocation: Invocation,
    bundle: BundleArgument = None,
    link: Link = None,
    listen: Listen = ANY_PORT,
    browser: Open = True,
) -> None:
    """Show the block in plan, the measuring mark and both plates in the browser; a click in the plan drives the mark.

    Without --link (or ORIP_LINK) the page has a plate processor of its own. The page can be seen only from this
    machine; Ctrl-C ends it.

    Example: orip drive watch
    """
    from orip.workflow.drive.listening import listening_address
    from orip.workflow.drive.watch import open_watch, watch_warnings

    address = listening_address(listen, ", which is where the page can be seen")
    watch = open_watch(invocation.folder, bundle, link)
    try:
        invocation.terminal.warn(watch_warnings(invocation.folder, bundle, link))
        with _server(watch, address) as server:
            invocation.terminal.answer("drive-watch", {"command": "drive watch", "url": server.url}, server.url)
            invocation.terminal.flush()
            invocation.terminal.say("Ctrl-C ends it")
            _serve(server, browser=browser)
    finally:
        watch.close()


def _server(watch: Watch, address: tuple[str, int]) -> WatchServer:
    from orip.link.watch_server import WatchServer

    try:
        return WatchServer(watch, address)
    except OSError as error:
        host, port = address
        why = error.strerror or error
        message = (
            f"port {port} of {host} cannot be taken ({why}); choose another; any that is free: --listen {ANY_PORT}"
        )
        raise OripError(message) from error


@contextmanager
def _page_to_open(server: WatchServer) -> Iterator[str]:
    """Yield what a browser is given to open: others can see its command, and with the token they could drive."""
    from orip.link.access import private_file

    page = f'<!doctype html><meta http-equiv="refresh" content="0; url={server.url}"><a href="{server.url}">orip</a>'
    try:
        path = private_file(f"watch-{server.port}.html", page)
    except (OSError, RuntimeError):
        yield server.url.replace(f"{server.token}/", "")  # tells to take the address that was printed
        return
    try:
        yield path.as_uri()
    finally:
        path.unlink(missing_ok=True)


def _serve(server: WatchServer, *, browser: bool) -> None:
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
