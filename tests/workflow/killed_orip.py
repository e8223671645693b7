"""Run orip and kill it without mercy at its n-th step: ``killed_orip.py STEP arguments``.

A step is what the system sees of a command: a statement to SQLite, a text flushed to the disk, a text renamed. Step 0
kills nothing but tells, in the last line of stdout, how many steps there were. Step -1 writes a line to stdout just
before each commit and rename, for a parent that kills from outside, in the middle of what SQLite does.
"""

from __future__ import annotations

import os
import signal
import sqlite3
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any
from unittest.mock import patch

MOMENT = b"moment\n"


class Steps:
    """Counts steps and ends the process before the one that was asked for."""

    def __init__(self, last: int) -> None:
        self.last = last
        self.count = 0

    def take(self, telling: bool) -> None:
        """Count a step; the process does not survive the last one."""
        self.count += 1
        if self.count == self.last:
            os.kill(os.getpid(), signal.SIGKILL)
        if self.last == -1 and telling:
            os.write(1, MOMENT)

    def before(self, function: Callable[..., Any], telling: bool = False) -> Callable[..., Any]:
        """Return the function with a step before it."""

        def stepped(*arguments: Any, **options: Any) -> Any:
            self.take(telling)
            return function(*arguments, **options)

        return stepped


@contextmanager
def counted(steps: Steps) -> Iterator[None]:
    """Count the steps of what runs in the block."""

    class Connection(sqlite3.Connection):
        def execute(self, sql: str, *parameters: Any) -> sqlite3.Cursor:
            steps.take(telling=sql == "COMMIT")
            return super().execute(sql, *parameters)

        def executemany(self, *arguments: Any) -> sqlite3.Cursor:
            steps.take(telling=False)
            return super().executemany(*arguments)

    connect = sqlite3.connect
    with (
        patch.object(sqlite3, "connect", lambda *args, **options: connect(*args, factory=Connection, **options)),
        patch.object(os, "fsync", steps.before(os.fsync)),
        patch.object(os, "replace", steps.before(os.replace, telling=True)),
    ):
        yield


def main() -> None:
    """Run orip with counted steps."""
    steps = Steps(int(sys.argv[1]))
    from orip.cli.main import main as orip

    sys.argv = ["orip", *sys.argv[2:]]
    try:
        with counted(steps):
            orip()
    finally:
        if steps.last == 0:
            os.write(1, f"{steps.count}\n".encode())


if __name__ == "__main__":
    main()
