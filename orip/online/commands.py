"""`orip online`: a session of measuring on stdin and stdout, served to programs over TCP, and shown in a browser."""

from __future__ import annotations

import json
import queue
import signal
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from orip.cli.options import BundleArgument, Invocation, command
from orip.errors import OripError, UsageError
from orip.threads import begin_thread, limited_threads

if TYPE_CHECKING:
    from orip.online.page import ServedSession
    from orip.online.replies import Reply


@contextmanager
def page_of(invocation: Invocation, session: ServedSession) -> Iterator[None]:
    """Serve the page of a session meanwhile; its address is printed."""
    from orip.web.serving import served_meanwhile

    with served_meanwhile(session.page) as address:
        invocation.terminal.say(f"the session can be watched at {address}")
        yield


@contextmanager
def answered_online(invocation: Invocation, bundle: str | None) -> Iterator[Callable[..., None]]:
    """Answer what is digitised meanwhile: each point that is written is handed to the function that is yielded."""
    from orip.online.page import ServedSession
    from orip.online.session import ANSWERED_WITHIN_S, OnlineSession
    from orip.threads import limited_threads

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


def session_to_measure(folder: Path, bundle: str | None) -> ServedSession:
    """Begin a session in a project for whoever measures; see `OnlineSession`."""
    from orip.online.page import ServedSession
    from orip.online.session import ANSWERED_WITHIN_S, OnlineSession

    return ServedSession(OnlineSession(folder, bundle, ANSWERED_WITHIN_S), folder)


def serve_programs(invocation: Invocation, session: ServedSession, address: tuple[str, int]) -> None:
    """Serve a session to programs until Ctrl-C.

    Raises
    ------
    OripError
        If the address is taken.
    """
    import asyncio

    from orip.online.server import Answering, OnlineServer
    from orip.web.access import new_token

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


_LOOKS_EVERY = 0.5
"""Seconds after which measurement files are looked at again, while nothing is asked."""

_BLUNDERS = 3
"""Of the simulated session."""

Demo = Annotated[
    bool, typer.Option("--demo", help="Play a simulated session with three wrong measurements; no project is needed.")
]


Listen = Annotated[
    str | None,
    typer.Option("--listen", metavar="HOST:PORT", help="Serve several programs instead of stdin; one may write."),
]
Page = Annotated[bool, typer.Option("--page", help="Show the session in the browser: its address is printed.")]


def tell_next(invocation: Invocation, bundle: str | None) -> None:
    """Tell what is worth measuring next, the most profitable first."""
    from orip.online.replies import shown
    from orip.online.requests import Request
    from orip.online.session import OnlineSession

    session = OnlineSession(invocation.folder, bundle)
    invocation.terminal.warn(session.warnings)
    advised = shown(session, Request("show", what="todo"))["todo"]
    if invocation.terminal.json:
        document = {"command": "observations todo", "bundle": session.bundle.name, "next": advised}
        invocation.terminal.document("todo-next", document)
        return
    for one in advised:
        gain = " " * 9 if one["gain"] is None else f"{one['gain']:5.1f} bit"
        invocation.terminal.data(f"{gain}  {one['text']}\n")


def register(app: typer.Typer) -> None:
    """Add the command."""

    @command(app, "online")
    def online_command(
        invocation: Invocation,
        bundle: BundleArgument = None,
        listen: Listen = None,
        page: Page = False,
        demo: Demo = False,
    ) -> None:
        """Check measurements as they are made and report wrong ones immediately.

        Requests are lines of JSON on stdin, replies on stdout; what others append to measurement files is answered as
        well. Every measurement is in EDITS.MEA before it is answered.

        Example: orip online --demo
        """
        if demo:
            _refuse_with_demo({"BUNDLE": bundle, "--listen": listen, "--page": page})
            _play(invocation)
            return
        from orip.web.access import listening_address

        address = None if listen is None else listening_address(listen, ", which is where programs can measure")
        from orip.online.page import ServedSession
        from orip.online.replies import shown
        from orip.online.session import ANSWERED_WITHIN_S, OnlineSession

        with limited_threads(invocation.terminal.threads):
            session = OnlineSession(invocation.folder, bundle, ANSWERED_WITHIN_S)
            invocation.terminal.warn(session.warnings)
            served = ServedSession(session, invocation.folder)
            with _shown(invocation, served) if page else nullcontext():
                if address is not None:
                    serve_programs(invocation, served, address)
                    return
                _put(invocation, shown(session))
                _serve(invocation, served)


def _shown(invocation: Invocation, session: ServedSession) -> AbstractContextManager[None]:
    # asyncio and a web server take their time to import

    return page_of(invocation, session)


def _serve(invocation: Invocation, session: ServedSession) -> None:
    """Answer until stdin ends or the session is asked to."""
    lines: queue.Queue[str | BaseException | None] = queue.Queue()
    session.on_news(partial(lines.put, ""))
    begin_thread(partial(_read, lines), "reading requests")
    while True:
        try:
            line = lines.get(timeout=_LOOKS_EVERY)
        except queue.Empty:
            line = ""
        if isinstance(line, BaseException):
            raise line
        for reply in session.news():
            _put(invocation, reply)
        answer = None if line is None else session.reply(line) if line.strip() else {}
        if answer is None:
            break
        if answer:
            _put(invocation, answer)
    for reply in session.ended():
        _put(invocation, reply)


def _read(lines: queue.Queue[str | BaseException | None]) -> None:
    """Put the lines of stdin, then None, or what has kept them from being read."""
    try:
        # a stream of its own: Python cannot end while a thread waits in that of sys.stdin
        with open(sys.stdin.fileno(), "rb", closefd=False) as stream:
            for line in stream:
                lines.put(line.decode("utf-8", errors="replace"))
    except BaseException as error:  # noqa: BLE001  # it is raised where the lines are waited for
        lines.put(error)
    else:
        lines.put(None)


def _put(invocation: Invocation, reply: dict[str, Any]) -> None:
    invocation.terminal.data(json.dumps(reply, ensure_ascii=False) + "\n")
    invocation.terminal.flush()


def _refuse_with_demo(given: dict[str, object]) -> None:
    if named := [name for name, value in given.items() if value]:
        message = f"--demo plays a simulated session on the terminal; leave {', '.join(named)} out"
        raise UsageError(message)


def _play(invocation: Invocation) -> None:
    """Play the simulated session: what is found out, as it is found out."""
    from orip.online.answers import words_of
    from orip.online.block.online_block import OnlineBlock
    from orip.online.fit import statistics_of
    from orip.online.measuring import Measuring
    from orip.online.replies import summary
    from orip.online.simulation import simplon_like_session

    say = invocation.terminal.say
    with limited_threads(None):
        session = simplon_like_session(_BLUNDERS)
        photos, points, _ = (set(column) for column in zip(*session.measurements, strict=True))
        say(
            f"{len(session.measurements)} measurements of {len(points)} points in {len(photos)} photos, seven elements "
            "of orientation, no control; wrong are:"
        )
        for blunder in session.blunders:
            say(f"  {blunder.point} in {blunder.photo} by ({blunder.error[0]:.3f}, {blunder.error[1]:.3f}) mm")
        measuring = Measuring(OnlineBlock(session.inputs))
        for number, measurement in enumerate(session.measurements, start=1):
            answer = measuring.measure(measurement)
            answer = measuring.reconsider() or answer
            at = f"{number:>4} {measurement[1]} in {measurement[0]}:"
            for photo in answer.oriented:
                say(f"{at} photo {photo} is oriented")
            for suspect in answer.suspects:
                also = f", or {', '.join(map(words_of, suspect.alike))}" if suspect.alike else ""
                say(f"{at} suspect is {words_of(suspect.key)}{also}; w {suspect.w:.1f}, limit {suspect.limit:.1f}")
            for key in answer.cleared:
                say(f"{at} {words_of(key)} fits now")
        found = statistics_of(measuring)
        say(
            f"{found['equations']} observations, {found['unknowns']} unknowns, redundancy {found['redundancy']}; "
            f"{2 * len(measuring.suspects)} observations are out"
        )
        named = [words_of(key) for key in measuring.suspects]
        invocation.terminal.answer(
            "online-demo",
            {"command": "online", "summary": summary(measuring), "suspects": named},
            f"{summary(measuring)}: {', '.join(named)}",
        )
