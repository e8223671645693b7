"""How far long work has come: who does it tells, who wants to know listens, and neither knows the other."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Protocol


class Listener(Protocol):
    """Who is told of stages. One begins within another, and ends before it."""

    def begin(self, what: str, total: int | None) -> None:
        """Hear that work begins; of so many steps, if that is known."""

    def advance(self, done: int) -> None:
        """Hear how many steps of the innermost stage are done."""

    def end(self) -> None:
        """Hear that the innermost stage is over."""


_listener: ContextVar[Listener | None] = ContextVar("listener", default=None)


@contextmanager
def listening(listener: Listener) -> Iterator[None]:
    """Let somebody hear of all stages that begin meanwhile."""
    token = _listener.set(listener)
    try:
        yield
    finally:
        _listener.reset(token)


@contextmanager
def stage(what: str, total: int | None = None) -> Iterator[Callable[[int], None]]:
    """Tell that work begins and ends; the function given tells how many steps are done."""
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
