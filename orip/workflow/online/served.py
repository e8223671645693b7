"""A session that answers lines, whoever sends them, with the page that shows it."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from pathlib import Path

from orip.errors import OripError
from orip.workflow.online.page import OnlinePage
from orip.workflow.online.replies import Reply, reply_of, reply_to, shown
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
        self.page = OnlinePage(session.bundle.name, lambda: session.measuring, self._lock)

    def greeting(self) -> Reply:
        """Return what a program is told first."""
        with self._lock:
            return shown(self._session, "summary")

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

    def appended(self) -> Iterator[Reply]:
        """Yield replies to what others have written to measurement files since."""
        with self._lock:
            try:
                replies = [reply_of(self._session, answer) for answer in self._session.appended()]
            except OripError as error:
                replies = [{"error": str(error)}]
            for reply in replies:
                self.page.answered(reply)
        yield from replies
