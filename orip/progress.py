"""Progress of long work: a function reports its stages, a listener shows them, and neither knows the other."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Protocol


class Listener(Protocol):
    """Receives reports on stages; a stage that begins within another one ends before it."""

    def begin(self, what: str, total: int | None) -> None:
        """Take note that a stage begins; `total` steps, None where their number is not known."""

    def advance(self, done: int) -> None:
        """Take note that so many steps of the innermost stage are done."""

    def end(self) -> None:
        """Take note that the innermost stage has ended."""


_listener: ContextVar[Listener | None] = ContextVar("listener", default=None)


@contextmanager
def listening(listener: Listener) -> Iterator[None]:
    """Report all stages that begin within the block to a listener."""
    token = _listener.set(listener)
    try:
        yield
    finally:
        _listener.reset(token)


@contextmanager
def stage(what: str, total: int | None = None) -> Iterator[Callable[[int], None]]:
    """Report the beginning and the end of a stage; the function that is yielded reports how many steps are done."""
    listener = _listener.get()
    if listener is None:
        yield _nobody_listens
        return
    listener.begin(what, total)
    try:
        yield listener.advance
    finally:
        listener.end()


def _nobody_listens(_done: int) -> None:
    pass
