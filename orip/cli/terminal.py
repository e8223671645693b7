"""What the user sees: data on stdout, messages on stderr, colour where it is wanted, a bar while work takes long."""

from __future__ import annotations

import json
import os
import sys
import textwrap
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, nullcontext
from threading import RLock, Timer
from typing import TYPE_CHECKING, Any, Literal, TextIO

from msgspec import Struct, field

from orip.errors import OripError, ProjectWarning, by_kind
from orip.files.text.shown import visible, visible_json
from orip.progress import listening

if TYPE_CHECKING:
    from rich.progress import Progress

    from orip.schemas.catalogue import SchemaName


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


ColorChoice = Literal["auto", "always", "never"]
Style = Literal["red", "yellow", "green", "bold", "bold red", "bold yellow", "dim"]

USUAL_COLUMNS = 80
LABEL_WIDTH = 9
"""Width of the label at the beginning of a line on stderr; continuation lines are indented by as much."""

_CODES: dict[Style, str] = {
    "red": "31",
    "yellow": "33",
    "green": "32",
    "bold": "1",
    "bold red": "1;31",
    "bold yellow": "1;33",
    "dim": "2",
}
_PLAIN = str.maketrans({"\N{NARROW NO-BREAK SPACE}": " ", "±": "+-", "−": "-", "–": "-", "°": " deg", "…": "..."})
"""Replacements for the symbols in messages, on a terminal that only has ASCII."""
_NARROWEST = 20


class Terminal(Struct, frozen=True):
    """How a command prints.

    Parameters
    ----------
    color : {"auto", "always", "never"}
        auto: on a terminal, unless NO_COLOR is set.
    threads : int or None
        Threads of an adjustment; None: see `orip.threads.available_threads`.
    """

    quiet: bool = False
    verbose: bool = False
    json: bool = False
    color: ColorChoice = "auto"
    threads: int | None = None
    _warned: set[str] = field(default_factory=set)
    _bars: list[ProgressBar] = field(default_factory=list)

    def say(self, text: str, style: Style | None = None) -> None:
        """Print a line on stderr, unless quiet."""
        if not self.quiet:
            self._talk(text, style)

    def point(self, label: str, text: str, style: Style | None = None) -> None:
        """Print a line on stderr with its label, unless quiet; bold applies to the line, other styles to the label."""
        if not self.quiet:
            whole = style is None or style.startswith("bold")
            self._talk(f"{label:{LABEL_WIDTH}}{text}", style, None if whole else len(label))

    def result(self, label: str, text: str, style: Style | None = None) -> None:
        """Print a line of a result for people on stdout, unless quiet; where stdout has a document, on stderr."""
        if self.json:
            self.point(label, text, style)
        elif not self.quiet:
            whole = style is None or style.startswith("bold")
            line = f"{label:{LABEL_WIDTH}}{text}"
            with self._bars[-1].aside() if self._bars else nullcontext():
                self._write("\n".join(self._lines(line, style, None if whole else len(label), sys.stdout)))
                self.flush()

    def detail(self, text: str) -> None:
        """Print a line on stderr if verbose."""
        if self.verbose:
            self.say(text, "dim")

    def warn(self, warnings: Iterable[ProjectWarning]) -> None:
        """Print warnings, unless quiet, those of a kind as one; each once, though several steps may give it."""
        for text in dict.fromkeys(map(str, by_kind(warnings))):
            if text not in self._warned:
                self._warned.add(text)
                if not self.quiet:
                    self._talk(f"warning: {text}", "yellow", len("warning:"))

    def error(self, text: str) -> None:
        """Print an error, quiet or not."""
        self._talk(f"error: {text}", "red", len("error:"))

    def data(self, text: str) -> None:
        """Print data on stdout; on a terminal control characters are shown, and do nothing."""
        if sys.stdout.isatty():
            text = visible(text, kept="\n\t")
        self._write(text)

    def tables(self, text: str) -> None:
        """Print tables on stdout; on a terminal those columns that it has room for, and what was left out."""
        from orip.files.text.table import fitted_tables

        columns = _columns_of(sys.stdout)
        self.data(text if columns is None else fitted_tables(text, columns))

    def _write(self, text: str) -> None:
        """Print a text on stdout as it is."""
        with _reader_may_leave(sys.stdout), output_taken():
            sys.stdout.write(text if text.endswith("\n") else f"{text}\n")

    def flush(self) -> None:
        """Hand the data on to their reader."""
        with _reader_may_leave(sys.stdout), output_taken():
            sys.stdout.flush()

    def document(self, schema: SchemaName, content: dict[str, Any]) -> None:
        """Print one JSON document on stdout; it names its schema first."""
        from orip.schemas.catalogue import identifier

        document = {"schema": identifier(schema), **content}
        self.data(visible_json(json.dumps(document, ensure_ascii=False, indent=2, allow_nan=False)))

    def answer(self, schema: SchemaName, content: dict[str, Any], text: str) -> None:
        """Print what was asked for: with ``--json`` a document, else a text."""
        if self.json:
            self.document(schema, content)
        else:
            self.data(text)

    @property
    def is_terminal(self) -> bool:
        """Tell whether somebody reads what is printed on stdout."""
        return sys.stdout.isatty()

    @property
    def columns(self) -> int | None:
        """Return the width of messages; None where they do not go to a terminal and lines are not broken."""
        return _columns_of(sys.stderr)

    @contextmanager
    def progress(self) -> Iterator[None]:
        """Show the progress of long work, on a terminal where it can be removed again."""
        if self.quiet or not sys.stderr.isatty() or os.environ.get("TERM", "dumb") == "dumb":
            yield
            return
        bar = ProgressBar(self.columns or USUAL_COLUMNS)
        self._bars.append(bar)
        try:
            with listening(bar):
                yield
        finally:
            self._bars.pop()

    def _talk(self, text: str, style: Style | None = None, styled: int | None = None) -> None:
        """Print on stderr, broken between words where that is a terminal.

        Parameters
        ----------
        styled : int or None
            Number of characters that have the style; None: all.
        """
        lines = self._lines(text, style, styled, sys.stderr)
        with self._bars[-1].aside() if self._bars else nullcontext():
            try:
                sys.stderr.write("".join(f"{line}\n" for line in lines))
                sys.stderr.flush()
            except OSError:  # nobody reads it, or the disk is full: the work goes on
                _send_nowhere(sys.stderr)

    def _lines(self, text: str, style: Style | None, styled: int | None, stream: TextIO) -> list[str]:
        """Return a text as the lines that a stream shows; see `_talk`."""
        text = visible(text, kept="\n")
        if (stream.encoding or "").lower().replace("-", "") not in {"utf8", "utf8sig"}:
            text = text.translate(_PLAIN)
        columns = _columns_of(stream)
        lines = [
            line
            for paragraph in text.split("\n")
            for line in ([paragraph] if columns is None else _wrapped(paragraph, columns))
        ]
        lines = [line.replace("\N{NO-BREAK SPACE}", " ") for line in lines]
        if styled is None:
            return [self._styled(line, style, stream) for line in lines]
        return [f"{self._styled(lines[0][:styled], style, stream)}{lines[0][styled:]}", *lines[1:]]

    def _styled(self, text: str, style: Style | None, stream: TextIO) -> str:
        if style is None or not self._has_color(stream):
            return text
        return f"\x1b[{_CODES[style]}m{text}\x1b[0m"

    def _has_color(self, stream: TextIO) -> bool:
        if self.color != "auto":
            return self.color == "always"
        return stream.isatty() and not os.environ.get("NO_COLOR") and os.environ.get("TERM") != "dumb"


def _columns_of(stream: TextIO) -> int | None:
    """Return the width of a stream; None where it is no terminal."""
    if not stream.isatty():
        return None
    try:
        columns = int(os.environ.get("COLUMNS") or 0) or os.get_terminal_size(stream.fileno()).columns
        return max(columns or USUAL_COLUMNS, _NARROWEST)
    except (OSError, ValueError):
        return USUAL_COLUMNS


@contextmanager
def _reader_may_leave(stream: TextIO) -> Iterator[None]:
    """Go on silently when the reader of the output has left, such as head or less: work and exit code stay the same."""
    try:
        yield
    except BrokenPipeError:
        _send_nowhere(stream)


@contextmanager
def output_taken() -> Iterator[None]:
    """Report that data cannot be written to stdout; no further data are written.

    Raises
    ------
    OripError
        In place of an OSError of the block.
    """
    try:
        yield
    except BrokenPipeError:
        raise
    except OSError as error:
        _send_nowhere(sys.stdout)
        message = f"the output cannot be written: {error.strerror or error}; send it to another file or disk"
        raise OripError(message) from error


def _send_nowhere(stream: TextIO) -> None:
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, stream.fileno())
    os.close(nowhere)


def _wrapped(line: str, columns: int) -> list[str]:
    """Break a line between words; continuation lines begin below the first word after the label."""
    if len(line) <= columns:
        return [line]
    return textwrap.wrap(
        line, columns, subsequent_indent=" " * LABEL_WIDTH, break_long_words=False, break_on_hyphens=False
    )


def warning_rows(warnings: Iterable[ProjectWarning]) -> list[dict[str, str]]:
    """Return warnings as JSON rows."""
    return [{"code": warning.code, "where": warning.where, "text": warning.text} for warning in warnings]
