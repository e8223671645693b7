"""The screen of `orip digitise --screen`: the display of ORIPROGRAM (Dueholm 1989, figure 4) with its seven areas.

Project line, the keys as the keypad has them, stage plate coordinates, results, a legend, eight lines that scroll, and
the command line. It is drawn anew whenever something is said, and while the operator is waited for.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Sequence
from typing import NamedTuple

from orip.errors import LinkError
from orip.multimodel.digitising.operator import Instrument, Visit
from orip.multimodel.state import Position, Status

WIDTH = 80
_RESULTS, _SCROLLED = 4, 8
_EVERY_S = 0.2
"""Between two looks at the plates."""

_LEGEND = f"{'outcome':<10} what, name and owner                        x           y"
_OUTCOMES = ("digitised", "skipped", "kept")
_CLEAR, _HOME, _REST_OF_LINE = "\x1b[2J", "\x1b[H", "\x1b[K"


class Shown(NamedTuple):
    """What the areas show: the keys of the menu by what they do, and the last lines of each area."""

    project: str
    activity: str
    keys: Sequence[tuple[str, str]]
    status: Status | None
    plates: tuple[Position, Position] | None
    results: Sequence[str]
    scrolled: Sequence[str]
    command: str


def screen_lines(shown: Shown) -> list[str]:
    """Return the screen, of 23 lines of 80 columns at the most."""
    title = f"ORIP  {shown.activity}"
    cells = [f"{key:>5} {what}" for key, what in shown.keys]
    cells += [""] * (16 - len(cells))
    menu = ["".join(f"{cell[:19]:<20}" for cell in cells[row : row + 4]) for row in range(0, 16, 4)]
    return [
        line[:WIDTH].rstrip()
        for line in (
            f"{title}{shown.project:>{WIDTH - len(title)}}",
            "-" * WIDTH,
            *menu,
            *_status_lines(shown),
            "-" * WIDTH,
            *_last(shown.results, _RESULTS),
            _LEGEND,
            *_last(shown.scrolled, _SCROLLED),
            f"> {shown.command}",
        )
    ]


def _status_lines(shown: Shown) -> list[str]:
    if shown.status is None or shown.plates is None:
        return ["", ""]
    status, (upper, lower) = shown.status, shown.plates
    prisms = " ".join(map(str, status.prisms))
    lock = status.lock or "NONE"
    return [
        f"upper {upper[0]:z12.4f} {upper[1]:z12.4f}    lower {lower[0]:z12.4f} {lower[1]:z12.4f}   mm",
        f"model {status.model}  {status.condition}  guide {status.guide}  lock {lock}  prisms {prisms}",
    ]


def _last(lines: Sequence[str], count: int) -> list[str]:
    found = list(lines)[-count:]
    return found + [""] * (count - len(found))


class Screen:
    """The screen of a session.

    Parameters
    ----------
    activity : str
        What is done, for the project line.
    write : function of a text
        To the terminal.
    """

    def __init__(self, activity: str, write: Callable[[str], None]) -> None:
        self.project = ""
        """Name of the project, once it is known."""
        self._activity, self._write = activity, write
        self._keys: tuple[tuple[str, str], ...] = ()
        self._results: deque[str] = deque(maxlen=_RESULTS)
        self._scrolled: deque[str] = deque(maxlen=_SCROLLED)
        self._command = ""
        self._status: Status | None = None
        self._plates: tuple[Position, Position] | None = None
        self._looked, self._drawn = 0.0, ""

    def tell(self, line: str) -> None:
        """Take a line of the session to its area: what is measured scrolls, figures are results, the rest commands."""
        if line.startswith(_OUTCOMES):
            self._scrolled.append(line)
        elif line.startswith("  "):
            self._results.append(line.strip())
        else:
            self._command = line
        self._draw()

    def waiting(self, visit: Visit) -> None:
        """Show the keys as they are for a visit."""
        self._keys = _keys_of(visit)
        self._draw()

    def look(self, link: Instrument) -> None:
        """Show where the plates are, some times a second."""
        if time.monotonic() < self._looked + _EVERY_S:
            return
        self._looked = time.monotonic()
        try:
            self._status, self._plates = link.status(), link.plates()
        except LinkError:
            return  # whoever waits for the next event says so
        self._draw()

    def _draw(self) -> None:
        lines = screen_lines(
            Shown(
                self.project, self._activity, self._keys, self._status, self._plates,
                self._results, self._scrolled, self._command,
            )
        )  # fmt: skip
        text = "".join(f"{line}{_REST_OF_LINE}\n" for line in lines)
        if text != self._drawn:
            self._write(f"{'' if self._drawn else _CLEAR}{_HOME}{text}")
            self._drawn = text


def _keys_of(visit: Visit) -> tuple[tuple[str, str], ...]:
    if visit.hint:
        names = (("1-9", "code"), ("ENTER", "end line"), ("ZERO", "end"), ("RFS", "vertex"), ("LFS", "take back"))
    else:
        names = (
            ("RFS", "digitise"),
            ("LFS", "lock, unlock" if visit.locks else "skip"),
            ("ENTER", "next model" if visit.is_new else "keep"),
            ("ZERO", "end"),
            *((("0-9", "name"),) if visit.is_new else ()),
        )
    return names
