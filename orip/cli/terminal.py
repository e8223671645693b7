"""What the user sees: data on stdout, talk on stderr, colour where it is wanted."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any, Literal, TextIO

from orip.errors import ProjectWarning

ColorChoice = Literal["auto", "always", "never"]
Style = Literal["red", "yellow", "green", "bold", "dim"]

_CODES: dict[Style, str] = {"red": "31", "yellow": "33", "green": "32", "bold": "1", "dim": "2"}


@dataclass(frozen=True, slots=True)
class Terminal:
    """How a command talks.

    Parameters
    ----------
    quiet, verbose, json : bool
    color : {"auto", "always", "never"}
        auto: on a terminal, unless NO_COLOR is set.
    threads : int
        Threads of the linear algebra.
    """

    quiet: bool = False
    verbose: bool = False
    json: bool = False
    color: ColorChoice = "auto"
    threads: int = 1
    _warned: set[str] = field(default_factory=set, compare=False)

    def say(self, text: str, style: Style | None = None) -> None:
        """Print a line of talk, unless quiet."""
        if not self.quiet:
            self._talk(self._styled(text, style, sys.stderr))

    def detail(self, text: str) -> None:
        """Print a line of talk if verbose."""
        if self.verbose:
            self.say(text, "dim")

    def warn(self, warnings: Iterable[ProjectWarning]) -> None:
        """Print warnings, unless quiet; each once, though several steps of a command may give it."""
        for text in dict.fromkeys(map(str, warnings)):
            if text not in self._warned:
                self._warned.add(text)
                self.say(f"{self._styled('warning:', 'yellow', sys.stderr)} {text}")

    def error(self, text: str) -> None:
        """Print an error, quiet or not."""
        self._talk(f"{self._styled('error:', 'red', sys.stderr)} {text}")

    def data(self, text: str) -> None:
        """Print data on stdout."""
        with _reader_may_leave(sys.stdout):
            sys.stdout.write(text if text.endswith("\n") else f"{text}\n")

    def flush(self) -> None:
        """Hand the data on to their reader."""
        with _reader_may_leave(sys.stdout):
            sys.stdout.flush()

    def document(self, content: dict[str, Any]) -> None:
        """Print one JSON document on stdout."""
        self.data(json.dumps(content, ensure_ascii=False, indent=2, allow_nan=False))

    @staticmethod
    def _talk(text: str) -> None:
        with _reader_may_leave(sys.stderr):
            sys.stderr.write(f"{text}\n")
            sys.stderr.flush()

    def _styled(self, text: str, style: Style | None, stream: TextIO) -> str:
        if style is None or not self._has_color(stream):
            return text
        return f"\x1b[{_CODES[style]}m{text}\x1b[0m"

    def _has_color(self, stream: TextIO) -> bool:
        if self.color != "auto":
            return self.color == "always"
        return stream.isatty() and not os.environ.get("NO_COLOR") and os.environ.get("TERM") != "dumb"


@contextmanager
def _reader_may_leave(stream: TextIO) -> Iterator[None]:
    """Go on in silence when the reader has seen enough, as head and less do: work and exit code are not theirs."""
    try:
        yield
    except BrokenPipeError:
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, stream.fileno())
        os.close(nowhere)


def warning_rows(warnings: Iterable[ProjectWarning]) -> list[dict[str, str]]:
    """Return warnings as JSON rows."""
    return [{"code": warning.code, "where": warning.where, "text": warning.text} for warning in warnings]
