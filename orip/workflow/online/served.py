"""A session that answers lines, whoever sends them, with the page that shows it."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from pathlib import Path

from orip.errors import OripError
from orip.workflow.online.page import OnlinePage
from orip.workflow.online.replies import Reply, reconsidered_of, reply_of, reply_to, shown
from orip.workflow.online.session import OnlineSession


class ServedSession:
    """A session, one request at a time; its page may be looked at meanwhile.

    Parameters
    ----------
    session : OnlineSession
    folder : Path
    """

    def __init__(self, session: OnlineSession, folder: Path) -> None:
        self._session, self._folder = session, folder
        self._lock = threading.Lock()
        self.page = OnlinePage(session, self._lock)

    def greeting(self) -> Reply:
        """Return what a program is told first."""
        with self._lock:
            return shown(self._session)

    def reply(self, line: str) -> Reply | None:
        """Return the reply to a line; None: who has sent it wants to leave."""
        with self._lock:
            reply = reply_to(self._session, self._folder, line)
            if reply is not None:
                self.page.answered(reply)
            return reply

    def written(self, photo: str, point: str, xy: tuple[float, float] | None) -> Reply | None:
        """Return the reply to what this program has written to a log; see `OnlineSession.written`."""
        with self._lock:
            answer = self._session.written(photo, point, xy)
            if answer is None:
                return None
            reply = reply_of(self._session, answer)
            self.page.answered(reply)
            return reply

    def on_news(self, wake: Callable[[], None]) -> None:
        """Have a function called, in any thread, when `news` may have something to say."""
        self._session.on_news(wake)

    def news(self) -> Iterator[Reply]:
        """Yield what has been reconsidered since, and replies to what others have written to measurement files."""
        with self._lock:
            replies = [*self._said_by(self._reconsidered()), *self._said_by(self._appended())]
        yield from replies

    def ended(self) -> Iterator[Reply]:
        """Yield what is still to be reconsidered, when it is."""
        with self._lock:
            assert self._session.measuring, "waited for"
            replies = list(self._said_by(self._reconsidered()))
        yield from replies

    def _reconsidered(self) -> Iterator[Reply]:
        for answer in self._session.reconsidered():
            reply = reconsidered_of(self._session, answer)
            self.page.answered(reply["reconsidered"])
            yield reply

    def _appended(self) -> Iterator[Reply]:
        for answer in self._session.appended():
            reply = reply_of(self._session, answer)
            self.page.answered(reply)
            yield reply

    def _said_by(self, replies: Iterator[Reply]) -> Iterator[Reply]:
        """Yield replies, the last one being what is wrong where something is."""
        try:
            yield from replies
        except OripError as error:
            reply = {"error": str(error)}
            self.page.answered(reply)
            yield reply
