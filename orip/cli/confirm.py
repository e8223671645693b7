"""Asking before something is done that the command cannot undo."""

from __future__ import annotations

import sys

import typer

from orip.errors import UsageError
from orip.files.text.shown import visible


def require_confirmation(question: str, yes: bool) -> None:
    """Go on if the user has agreed in advance (``--yes``) or agrees on the terminal.

    Raises
    ------
    UsageError
        If there is nobody to ask, as in a script.
    typer.Abort
        If the answer is no.
    """
    if yes:
        return
    if not sys.stdin.isatty():
        message = f"{question} Say so with --yes"
        raise UsageError(message)
    typer.confirm(visible(question), abort=True, err=True)
