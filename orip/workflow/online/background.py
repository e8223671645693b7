"""A session that answers soon: what takes longer is reconsidered after the answer, in the background.

Requests are carried out one after the other, each with all that follows from it before the next one begins. So where a
session ends does not depend on how fast it was asked; only what is said at once does.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from typing import NamedTuple

from orip.online.answers import Answer
from orip.online.measuring import Measuring

Operation = Callable[[Measuring], Answer | None]
"""A request; None is returned by one that has no answer."""


class _Asked(NamedTuple):
    """A request on its way: what it answers, what that has become after reconsidering, and whether it was told."""

    first: Future[Answer | None]
    later: Future[Answer | None]
    is_told: bool


class Background:
    """A session of measuring in a thread of its own.

    Parameters
    ----------
    measuring : Measuring
    seconds : float or None
        How long an answer is waited for; None: as long as it takes.
    """

    def __init__(self, measuring: Measuring, seconds: float | None) -> None:
        self._measuring, self._seconds = measuring, seconds
        self._thread = ThreadPoolExecutor(1, "measuring")
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
        """
        first = self._thread.submit(operation, self._measuring)
        later = self._thread.submit(self._measuring.reconsider)
        later.add_done_callback(lambda _: self.wake())
        try:
            answer, is_told = first.result(self._seconds), True
        except TimeoutError:
            answer, is_told = None, False
        self._asked.append(_Asked(first, later, is_told))
        return answer

    def reconsidered(self) -> Iterator[Answer]:
        """Yield the answers that have changed since they were given, and those that took longer than was waited for."""
        while self._asked and self._asked[0].later.done():
            asked = self._asked.popleft()
            answer = asked.later.result() or (None if asked.is_told else asked.first.result())
            if answer is not None:
                yield answer
