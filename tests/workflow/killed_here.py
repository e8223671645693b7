"""A process that dies at a step, played in this one: quicker than a process of its own, and nearly as merciless."""

from __future__ import annotations

import os
import sqlite3
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any
from unittest.mock import patch


class Killed(BaseException):
    """The process is gone."""


@contextmanager
def killed_at(step: int | None) -> Iterator[Callable[[], int]]:
    """Let the process die before a step that the system sees, and do nothing any more after that.

    Gives a function that tells how many steps there were.
    """
    count = 0

    def take() -> None:
        nonlocal count
        count += 1
        if step is not None and count >= step:
            raise Killed

    class Connection(sqlite3.Connection):
        def execute(self, sql: str, *parameters: Any) -> sqlite3.Cursor:
            take()
            return super().execute(sql, *parameters)

        def executemany(self, *arguments: Any) -> sqlite3.Cursor:
            take()
            return super().executemany(*arguments)

    def stepped(function: Callable[..., Any]) -> Callable[..., Any]:
        def run(*arguments: Any, **options: Any) -> Any:
            take()
            return function(*arguments, **options)

        return run

    connect = sqlite3.connect
    with (
        patch.object(sqlite3, "connect", lambda *args, **options: connect(*args, factory=Connection, **options)),
        patch.object(os, "fsync", stepped(os.fsync)),
        patch.object(os, "replace", stepped(os.replace)),
    ):
        yield lambda: count
