"""A session that answers soon: what takes longer is reconsidered after the answer, in the background.

Requests are carried out one after the other, each with all that follows from it before the next one begins. So where a
session ends does not depend on how fast it was asked; only what is said at once does.
"""

from __future__ import annotations

import weakref
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from functools import partial
from queue import SimpleQueue
from typing import NamedTuple

from orip.online.answers import Answer
from orip.online.measuring import Measuring
from orip.threads import begin_thread

Operation = Callable[[Measuring], Answer | None]
"""A request; None is returned by one that has no answer."""


class _Asked(NamedTuple):
    """A request on its way: what it answers, what that has become after reconsidering, and whether it was told."""

    first: Future[Answer | None]
    later: Future[Answer | None]
    is_told: bool


class _Work(NamedTuple):
    """What is to be done, and who waits for it."""

    task: Callable[[], Answer | None]
    result: Future[Answer | None]


def _do(works: SimpleQueue[_Work | None]) -> None:
    """Do one work after the other, until there is None."""
    while (work := works.get()) is not None:
        task, result = work
        try:
            found = task()
        except BaseException as error:  # noqa: BLE001  # it is raised where the result is asked for
            result.set_exception(error)
        else:
            result.set_result(found)
        # while it waits, it keeps nothing of a session that is over
        del work, task, result


class Background:
    """A session of measuring in a thread of its own, which begins with the first request.

    Parameters
    ----------
    measuring : Measuring
    seconds : float or None
        How long an answer is waited for; None: as long as it takes.
    """

    def __init__(self, measuring: Measuring, seconds: float | None) -> None:
        self._measuring, self._seconds = measuring, seconds
        self._works: SimpleQueue[_Work | None] | None = None
        self._asked: deque[_Asked] = deque()
        self.wake: Callable[[], None] = lambda: None
        """Called, in any thread, when something may have been reconsidered."""

    @property
    def is_busy(self) -> bool:
        """Return whether something is under way."""
        return bool(self._asked) and not self._asked[-1].later.done()

    def measuring(self) -> Measuring:
        """Wait until nothing is under way any more, and return what is measured."""
        if self._asked:
            self._asked[-1].later.result()
        return self._measuring

    def ask(self, operation: Operation) -> Answer | None:
        """Carry a request out; return its answer, or None if that takes longer: then it follows.

        Raises
        ------
        OripError
            From the request.
        MemoryError
            From the request, or if there is no thread for it.
        """
        first = self._submit(partial(operation, self._measuring))
        later = self._submit(self._measuring.reconsider)
        later.add_done_callback(lambda _: self.wake())
        try:
            answer, is_told = first.result(self._seconds), True
        except TimeoutError:
            answer, is_told = None, False
        self._asked.append(_Asked(first, later, is_told))
        return answer

    def _submit(self, task: Callable[[], Answer | None]) -> Future[Answer | None]:
        if self._works is None:
            works = SimpleQueue[_Work | None]()
            begin_thread(partial(_do, works), "the session")
            weakref.finalize(self, works.put, None)
            self._works = works
        result: Future[Answer | None] = Future()
        self._works.put(_Work(task, result))
        return result

    def reconsidered(self) -> Iterator[Answer]:
        """Yield the answers that have changed since they were given, and those that took longer than was waited for."""
        while self._asked and self._asked[0].later.done():
            asked = self._asked.popleft()
            answer = asked.later.result() or (None if asked.is_told else asked.first.result())
            if answer is not None:
                yield answer
