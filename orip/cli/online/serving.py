"""Serving a session: to programs over TCP, and to a browser."""

from __future__ import annotations

import asyncio
import json
import signal
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from orip.errors import OripError
from orip.threads import begin_thread

if TYPE_CHECKING:
    from orip.cli.options import Invocation
    from orip.workflow.online.replies import Reply
    from orip.workflow.online.served import ServedSession


@contextmanager
def page_of(invocation: Invocation, session: ServedSession) -> Iterator[None]:
    """Serve the page of a session meanwhile; its address is printed."""
    from orip.link.watch_server import WatchServer

    server = WatchServer(session.page)
    begin_thread(server.serve_forever, "the page")
    invocation.terminal.say(f"the session can be watched at {server.url}")
    try:
        yield
    finally:
        server.shutdown()
        server.server_close()


@contextmanager
def answered_online(invocation: Invocation, bundle: str | None) -> Iterator[Callable[..., None]]:
    """Answer what is digitised meanwhile: each point that is written is handed to the function that is yielded."""
    from orip.threads import limited_threads
    from orip.workflow.online.served import ServedSession
    from orip.workflow.online.session import ANSWERED_WITHIN_S, OnlineSession

    with limited_threads(invocation.terminal.threads):
        session = ServedSession(OnlineSession(invocation.folder, bundle, ANSWERED_WITHIN_S), invocation.folder)

        def say(replies: Iterable[Reply]) -> None:
            for reply in replies:
                answer = reply.get("reconsidered", reply)
                invocation.terminal.say(answer.get("error") or answer["text"])
                for suspect in answer.get("suspects", ()):
                    if (suspect["photo"], suspect["point"]) != (answer["photo"], answer["point"]):
                        invocation.terminal.say(f"{suspect['observation']} does not fit: measure it again")

        def written(photo: str, point: str, xy: tuple[float, float] | None) -> None:
            answer = session.written(photo, point, xy)
            say([] if answer is None else [answer])
            say(session.news())

        with page_of(invocation, session):
            yield written
        say(session.ended())


def serve_programs(invocation: Invocation, session: ServedSession, address: tuple[str, int]) -> None:
    """Serve a session to programs until Ctrl-C.

    Raises
    ------
    OripError
        If the address is taken.
    """
    from orip.link.access import new_token
    from orip.link.online_server import Answering, OnlineServer

    token = new_token()
    server = OnlineServer(Answering(session.greeting, session.reply, session.news, session.on_news), token)

    def listening(host: str, port: int) -> None:
        at = f"[{host}]:{port}" if ":" in host else f"{host}:{port}"
        invocation.terminal.data(json.dumps({"listening": at, "token": token}) + "\n")
        invocation.terminal.flush()

    async def serve() -> None:
        end, loop = asyncio.Event(), asyncio.get_running_loop()

        def stop(number: int, _: object) -> None:
            signal.signal(number, signal.default_int_handler)  # a second one ends what is being computed
            loop.call_soon_threadsafe(end.set)

        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, stop)
        await server.serve(*address, listening, end.wait())

    try:
        asyncio.run(serve())
    except OSError as error:
        message = f"{address[0]}:{address[1]} cannot be listened at: {error.strerror}"
        raise OripError(message) from error
