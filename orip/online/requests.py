"""Requests of a session as lines of JSON, and a session that answers soon and reconsiders in the background."""

from __future__ import annotations

import json
import math
import weakref
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from functools import partial
from queue import SimpleQueue
from typing import Literal, NamedTuple, cast, get_args

from msgspec import Struct

from orip.errors import UsageError
from orip.online.answers import Answer
from orip.online.measuring import Measuring
from orip.records.names import name_fault
from orip.threads import begin_thread

Do = Literal["measure", "remove", "exclude", "include", "undo", "show", "relinearise", "add", "solve", "quit"]
Added = Literal["control", "distances", "photos"]
Shown = Literal[
    "summary",
    "waiting",
    "suspects",
    "todo",
    "photos",
    "points",
    "cameras",
    "residuals",
    "given",
    "measured",
    "statistics",
]

_OF_POINT = frozenset({"measure", "remove", "exclude", "include"})
_ALLOWED = {
    **dict.fromkeys(_OF_POINT, frozenset({"photo", "point"})),
    "measure": frozenset({"photo", "point", "x", "y"}),
    "show": frozenset({"what", "photo", "point"}),
    "add": frozenset({"what", "number"}),
    "solve": frozenset({"prune"}),
}
_OF_GIVEN = frozenset({"exclude", "include"})
"""The keys of a request beside `do`."""

_MOST_ADDED = 20
"""What to add at once: each takes a moment of search."""

_LONGEST = 4096
"""Characters of a line; a longer one is no request."""


class Request(Struct, frozen=True):
    """A request.

    Parameters
    ----------
    photo, point : str
        Of `measure`, `remove`, `exclude` and `include`; of `show` for residuals: of these alone, empty for all.
    xy : tuple of float
        Of `measure`: as in a measurement file, plate millimetres or pixels.
    what : Shown
        Of `show`.
    added, number : Added, int
        Of `add`: what could be observed beside what is measured, and how many of them.
    observation : str
        Of `exclude` and `include`, in place of a photo point: what was given, as answers call it.
    prune : bool
        Of `solve`: whether camera parameters that are not determinable or not significant are held.
    """

    do: Do
    photo: str = ""
    point: str = ""
    xy: tuple[float, float] = (0.0, 0.0)
    what: Shown = "summary"
    prune: bool = False
    observation: str = ""
    added: Added = "photos"
    number: int = 1


def read_request(line: str) -> Request:
    """Return the request of a line.

    Raises
    ------
    UsageError
        With what is wrong and what is allowed.
    """
    given = _object(line)
    do = given.pop("do", None)
    if do not in get_args(Do):
        message = f'"do" is {_shown(do)}; it is one of {", ".join(get_args(Do))}'
        raise UsageError(message)
    allowed = _ALLOWED.get(str(do), frozenset())
    if do in _OF_GIVEN and "observation" in given:
        allowed = frozenset({"observation"})
    wrong = sorted(set(given) - allowed)
    if wrong:
        message = (
            f'"{do}" does not have {", ".join(map(_shown, wrong))}; it has {", ".join(sorted(allowed)) or "no more"}'
        )
        raise UsageError(message)
    if do == "show":
        what = _what(given.get("what", "summary"))
        if what != "residuals" and given.keys() & {"photo", "point"}:
            message = f'"show" has a photo or point for "what": "residuals" alone, not for {_shown(what)}'
            raise UsageError(message)
        photo, point = (_name(given, key) if key in given else "" for key in ("photo", "point"))
        return Request("show", photo, point, what=what)
    if do == "add":
        return Request("add", added=_added(given.get("what")), number=_count(given.get("number", 1)))
    if do == "solve":
        return Request("solve", prune=_flag(given, "prune"))
    if do not in _OF_POINT:
        return Request(cast(Do, do))
    if "observation" in given:
        return Request(cast(Do, do), observation=_name_of_observation(given))
    photo, point = (_name(given, key) for key in ("photo", "point"))
    xy = (_number(given, "x"), _number(given, "y")) if do == "measure" else (0.0, 0.0)
    return Request(cast(Do, do), photo, point, xy)


def _object(line: str) -> dict[str, object]:
    try:
        found = json.loads(line) if len(line) <= _LONGEST else None
    except (ValueError, RecursionError):
        found = None
    if not isinstance(found, dict):
        message = (
            f'this is not a request: {_shown(line)}; a request is a line such as {{"do": "show", "what": "waiting"}}'
        )
        raise UsageError(message)
    return found


def _what(given: object) -> Shown:
    if given not in get_args(Shown):
        message = f'"what" is {_shown(given)}; it is one of {", ".join(get_args(Shown))}'
        raise UsageError(message)
    return cast(Shown, given)


def _added(given: object) -> Added:
    if given not in get_args(Added):
        message = f'"what" is {_shown(given)}; it is one of {", ".join(get_args(Added))}'
        raise UsageError(message)
    return cast(Added, given)


def _count(given: object) -> int:
    if isinstance(given, bool) or not isinstance(given, int) or not 1 <= given <= _MOST_ADDED:
        message = f'"number" is {_shown(given)}; it is a whole number from 1 to {_MOST_ADDED}'
        raise UsageError(message)
    return given


def _name_of_observation(given: dict[str, object]) -> str:
    words = given["observation"]
    if not isinstance(words, str) or not words.isprintable():
        message = f'"observation" is {_shown(words)}; write what answers call it, such as "control point 7"'
        raise UsageError(message)
    return words


def _name(given: dict[str, object], key: str) -> str:
    name = given.get(key)
    if not isinstance(name, str):
        message = f'"{key}" is {_shown(name)}; give its name in quotes'
        raise UsageError(message)
    if fault := name_fault(name):
        raise UsageError(fault)
    return name


def _flag(given: dict[str, object], key: str) -> bool:
    value = given.get(key, False)
    if not isinstance(value, bool):
        message = f'"{key}" is {_shown(value)}; it is true or false'
        raise UsageError(message)
    return value


def _number(given: dict[str, object], key: str) -> float:
    value = given.get(key)
    # no plate and no picture is larger: the log has four decimals
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value) or abs(value) > 1e6:
        message = f'"{key}" is {_shown(value)}; it is a number of plate millimetres or pixels'
        raise UsageError(message)
    return float(value)


def _shown(value: object) -> str:
    text = value if isinstance(value, str) else "missing" if value is None else json.dumps(value)
    short = text if len(text) <= 60 else f"{text[:60]}..."
    return short if value is None else repr(short)


# Requests are carried out one after the other, each with all that follows from it before the next one begins. So where
# a session ends does not depend on how fast it was asked; only what is said at once does.


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
    seconds : float or None
        How long an answer is waited for; None: as long as it takes.
    """

    def __init__(self, measuring: Measuring, seconds: float | None) -> None:
        self._measuring, self._seconds = measuring, seconds
        self._works: SimpleQueue[_Work | None] | None = None
        self._asked: deque[_Asked] = deque()
        self.count = 0
        """Of requests."""
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
        self.count += 1
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
