"""The commands of the program and the documents that they print, as the program itself has them."""

from __future__ import annotations

from functools import cache
from typing import Any

import typer

from orip.cli.main import app
from orip.cli.options import SharedOptions
from orip.schemas.catalogue import DOCUMENTS, identifier

SHARED = {f"--{name}" for name in SharedOptions._fields}
"""Options that every command takes."""


def program() -> Any:
    """Return the program as typer has put it together."""
    return typer.main.get_command(app)


@cache
def commands() -> dict[str, Any]:
    """Return all commands and groups by the words that call them, such as ``control points add``; without ``orip``."""
    found: dict[str, Any] = {}

    def walk(command: Any, words: tuple[str, ...]) -> None:
        if words:
            found[" ".join(words)] = command
        if is_group(command):
            for name in command.list_commands(None):
                walk(command.get_command(None, name), (*words, name))

    walk(program(), ())
    return found


def is_group(command: Any) -> bool:
    """Tell whether a command has commands of its own."""
    return hasattr(command, "list_commands")


def options_of(command: Any) -> set[str]:
    """Return all options that a command takes, in all spellings."""
    return {text for param in command.params for text in (*param.opts, *param.secondary_opts) if text.startswith("-")}


def documents() -> list[tuple[str, str, str]]:
    """Return the schema of each document for programs, what writes it, and what it holds."""
    return [
        (
            f"`{identifier(name)}`",
            ", ".join(words if words.startswith("any ") else f"`{words}`" for words in document.written_by),
            str(document.content.__doc__).rstrip("."),
        )
        for name, document in DOCUMENTS.items()
    ]
