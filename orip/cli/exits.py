"""How commands end: every error of orip's becomes a message and an exit code; a traceback never reaches a user."""

from __future__ import annotations

import os
import re
import traceback
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

import typer

from orip.cli.terminal import ColorChoice, Terminal
from orip.errors import INTERRUPTED, InputError, NoFolderError, NoProjectError, OripError, UsageError

_TRACEBACK_VARIABLE = "ORIP_TRACEBACK"

NOTHING_WRITTEN = "; nothing was written"
"""Said after the number of errors, except by commands that only read and could not have written anything."""

_ADVICE: dict[type[OripError], str] = {
    NoFolderError: "name a project's folder with -C DIR",
    NoProjectError: "go to the project's folder, name it with -C DIR, or begin with a sample: orip init --sample",
}
"""What to do about errors that options of the command line help with; the API raises them too, and has no options."""


@contextmanager
def exit_on_error(terminal: Terminal, closing: str = NOTHING_WRITTEN) -> Iterator[None]:
    """Print what went wrong, with its closing words after several errors, and leave with its exit code."""
    try:
        try:
            yield
        finally:
            terminal.flush()
    except OripError as error:
        report(terminal, error, closing=closing)
        raise typer.Exit(error.exit_code) from None
    except KeyboardInterrupt:
        message = "interrupted; stores and outputs are consistent; 'orip status' shows what remains to be done"
        report(terminal, OripError(message), INTERRUPTED)
        raise typer.Exit(INTERRUPTED) from None
    except (OSError, MemoryError) as error:
        report(terminal, OripError(f"the system refused: {_reason(error)}"))
        raise typer.Exit(OripError.exit_code) from None
    except (typer.Exit, typer.Abort):
        raise
    except Exception as error:  # noqa: BLE001  # the last line of defence: a user never sees a traceback
        _report_internal(terminal, error)
        raise typer.Exit(1) from None


@contextmanager
def warnings_kept_back() -> Iterator[None]:
    """Let no warning of a library reach the user, who cannot do anything about it; whoever asks for tracebacks sees it.

    What a calculation cannot do is an error or a warning of orip's own. In the tests every warning is an error.
    """
    with warnings.catch_warnings():
        shown = warnings.showwarning
        warnings.showwarning = shown if os.environ.get(_TRACEBACK_VARIABLE) else _kept_back
        yield


def _kept_back(*_: object, **__: object) -> None:
    """Show nothing."""


def report_usage(error: typer.TyperException, arguments: Sequence[str]) -> int:
    """Print what is wrong with a command line that could not be parsed, and return the exit code."""
    # the shared options have not been parsed: they are guessed from the words
    colors: dict[bool, ColorChoice] = {True: "never", False: "auto"}
    never = "--color=never" in arguments or "never" in arguments
    terminal = Terminal(json="--json" in arguments, color=colors[never])
    said, context = error.format_message(), getattr(error, "ctx", None)
    if context and said == context.get_help():  # a group without its command
        if not terminal.json:
            terminal.say(said)
            return UsageError.exit_code
        said = "a command is missing"
    message = " ".join(said.split()).replace("Value error, ", "").rstrip(".")
    path = context.command_path if context else "orip"
    if path != "orip" and re.match(r"No such option: (-C|--project)\b", message):
        command = path.removeprefix("orip ")
        message = f"the project's folder stands before the command: write orip -C DIR {command}"
    stop = "" if message.endswith("?") else ";"
    report(terminal, UsageError(f"{message}{stop} see '{path} --help'"))
    with suppress(OripError):
        terminal.flush()
    return UsageError.exit_code


def _reason(error: OSError | MemoryError) -> str:
    """Say what was refused, and what to look at; files under a temporary name are called by their folder."""
    if not isinstance(error, OSError) or error.strerror is None or error.filename is None:
        return str(error) or "out of memory"
    path = Path(os.fsdecode(error.filename))
    shown = path.parent if path.name.startswith(".orip-") else path
    return f"{error.strerror}: {shown}; check its permissions and the disk, or choose another folder"


def report(terminal: Terminal, error: OripError, exit_code: int | None = None, closing: str = NOTHING_WRITTEN) -> int:
    """Print an error with all its complaints, as JSON too if that is wanted, and return the exit code."""
    complaints = error.told if isinstance(error, InputError) else ()
    advice = f"; {_ADVICE[type(error)]}" if type(error) in _ADVICE else ""
    if terminal.json:
        rows = [
            {
                "file": complaint.path or None,
                "line": complaint.line,
                "column": complaint.column,
                "message": f"{complaint.message}{advice}",
            }
            for complaint in complaints
        ] or [{"file": None, "line": None, "column": None, "message": f"{error}{advice}"}]
        with suppress(OripError):  # stdout may be full, which may be the error itself: it is on stderr below
            terminal.document("error", {"exit_code": exit_code or error.exit_code, "errors": rows})
            terminal.flush()
    for text in [str(complaint) for complaint in complaints] or [str(error)]:
        terminal.error(f"{text}{advice}")
    if isinstance(error, InputError) and len(error.complaints) > 1:
        terminal.say(f"{len(error.complaints)} errors{closing}")
    return exit_code or error.exit_code


def _report_internal(terminal: Terminal, error: Exception) -> None:
    message = (
        f"internal error: {type(error).__name__}: {error}; this is a fault of orip, please report it "
        f"(set {_TRACEBACK_VARIABLE}=1 to see where)"
    )
    report(terminal, OripError(message))
    if os.environ.get(_TRACEBACK_VARIABLE):
        traceback.print_exception(error)
