"""A bar on stderr for work that takes longer than a moment; it is removed when the work is done."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from threading import RLock, Timer
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.progress import Progress

DELAY_SECONDS = 1.0
"""Seconds that work takes before a bar is shown."""

_WIDTHS = (5, 24)
_BESIDES = 48
"""Columns that the text beside the bar may take."""


class ProgressBar:
    """The outermost stage of the current work, with the time it has taken.

    The bar is shown by a thread of its own, so that a stage that reports nothing until it ends has one, too.

    Parameters
    ----------
    columns : int
        Width of the terminal.
    """

    def __init__(self, columns: int) -> None:
        self._columns = columns
        self._lock = RLock()
        self._depth = 0
        self._what = ""
        self._total: int | None = None
        self._done = 0
        self._timer: Timer | None = None
        self._display: Progress | None = None

    def begin(self, what: str, total: int | None) -> None:
        """Show a stage, after a while."""
        with self._lock:
            self._depth += 1
            if self._depth > 1:
                return
            self._what, self._total, self._done = what, total, 0
            self._timer = Timer(DELAY_SECONDS, self._appear)
            self._timer.daemon = True
            self._timer.start()

    def advance(self, done: int) -> None:
        """Show how far the stage has advanced."""
        with self._lock:
            if self._depth == 1:
                self._done = done
                self._update()

    def end(self) -> None:
        """Remove what is shown."""
        with self._lock:
            self._depth -= 1
            if self._depth:
                return
            if self._timer is not None:
                self._timer.cancel()
                self._timer = None
            if self._display is not None:
                self._display.stop()
                self._display = None

    @contextmanager
    def aside(self) -> Iterator[None]:
        """Take the bar away while something is written, and put it back below."""
        with self._lock:
            if self._display is None:
                yield
                return
            self._display.stop()
            try:
                yield
            finally:
                self._display.start()

    def _appear(self) -> None:
        with self._lock:
            if self._depth and self._display is None and self._timer is not None:
                self._display = _display(self._columns)
                self._display.add_task(self._what, total=self._total, count="")
                self._update()
                self._display.start()

    def _update(self) -> None:
        if self._display is not None:
            count = "" if self._total is None else f"{self._done}/{self._total}"
            self._display.update(self._display.task_ids[0], completed=self._done, count=count)


def _display(columns: int) -> Progress:
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    console = Console(file=sys.stderr, force_terminal=True, no_color=True, highlight=False, width=columns)
    least, most = _WIDTHS
    return Progress(
        TextColumn("{task.description}", markup=False),
        BarColumn(min(max(columns - _BESIDES, least), most)),
        TextColumn("{task.fields[count]}", markup=False),
        TimeElapsedColumn(),
        console=console,
        transient=True,
        redirect_stdout=False,
        redirect_stderr=False,
    )
