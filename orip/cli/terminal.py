"""What the user sees: data on stdout, messages on stderr, colour where it is wanted."""

from __future__ import annotations

import json
import os
import sys
import textwrap
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, nullcontext
from typing import TYPE_CHECKING, Any, Literal, TextIO

from msgspec import Struct, field

from orip.cli.progress_bar import ProgressBar
from orip.errors import OripError, ProjectWarning, by_kind
from orip.files.text.shown import visible, visible_json
from orip.progress import listening

if TYPE_CHECKING:
    from orip.schemas.catalogue import SchemaName

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
    quiet, verbose, json : bool
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
        text : str
        style : Style or None
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
