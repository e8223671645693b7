"""How commands end: every error of orip's becomes a message and an exit code; a traceback never reaches a user."""

from __future__ import annotations

import os
import sys
import traceback
from collections.abc import Iterator
from contextlib import contextmanager

import typer

from orip.cli.terminal import Terminal
from orip.errors import InputError, OripError

INTERRUPTED = 130
_TRACEBACK_VARIABLE = "ORIP_TRACEBACK"


@contextmanager
def exit_on_error(terminal: Terminal) -> Iterator[None]:
    """Print what went wrong and leave with its exit code."""
    try:
        yield
    except OripError as error:
        _report(terminal, error)
        raise typer.Exit(error.exit_code) from None
    except KeyboardInterrupt:
        terminal.error("interrupted; nothing was changed")
        raise typer.Exit(INTERRUPTED) from None
    except BrokenPipeError:
        # the reader of our output has gone; what follows must not complain again while Python shuts down
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        raise typer.Exit(1) from None
    except (OSError, MemoryError) as error:
        terminal.error(f"the system refused: {error or type(error).__name__}")
        raise typer.Exit(1) from None
    except (typer.Exit, typer.Abort):
        raise
    except Exception as error:  # noqa: BLE001  # the last line of defence: a user never sees a traceback
        _report_internal(terminal, error)
        raise typer.Exit(1) from None


def _report(terminal: Terminal, error: OripError) -> None:
    complaints = error.complaints if isinstance(error, InputError) else ()
    if terminal.json:
        rows = [
            {"file": each.path or None, "line": each.line, "column": each.column, "message": each.message}
            for each in complaints
        ] or [{"file": None, "line": None, "column": None, "message": str(error)}]
        terminal.document({"schema": "orip.error/1", "exit_code": error.exit_code, "errors": rows})
    for text in [str(each) for each in complaints] or [str(error)]:
        terminal.error(text)
    if len(complaints) > 1:
        terminal.say(f"{len(complaints)} errors; nothing was written")


def _report_internal(terminal: Terminal, error: Exception) -> None:
    terminal.error(
        f"internal error: {type(error).__name__}: {error}; this is a fault of orip, please report it "
        f"(set {_TRACEBACK_VARIABLE}=1 to see where)"
    )
    if os.environ.get(_TRACEBACK_VARIABLE):
        traceback.print_exception(error)
