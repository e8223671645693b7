"""Options that every command shares, accepted before and after its name with the same meaning."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import typer

from orip.cli.exits import exit_on_error
from orip.cli.terminal import ColorChoice, Terminal

Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="Print errors only.")]
Verbose = Annotated[bool, typer.Option("--verbose", "-v", help="Print more of what is done.")]
Json = Annotated[bool, typer.Option("--json", help="Print one JSON document on stdout.")]
Color = Annotated[
    ColorChoice | None, typer.Option("--color", help="Colour: auto (default; on a terminal), always, never.")
]
Threads = Annotated[int | None, typer.Option("--threads", min=1, help="Threads of the linear algebra (default 1).")]


@dataclass(frozen=True, slots=True)
class Session:
    """What a command gets beside its own options: the project folder, and how to talk."""

    folder: Path
    terminal: Terminal


def first_options(quiet: bool, verbose: bool, json: bool, color: ColorChoice | None, threads: int | None) -> Terminal:
    """Return the terminal that the options before the command ask for."""
    return Terminal(quiet, verbose, json, color or "auto", threads or 1)


def command(app: typer.Typer, name: str) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Register a function ``f(session, ...)`` as a command that also takes the shared options.

    Errors of orip end the command with their message and exit code.
    """

    def register(function: Callable[..., None]) -> Callable[..., None]:
        @functools.wraps(function)
        def run(context: typer.Context, **given: Any) -> None:
            session: Session = context.obj
            late = first_options(*(given.pop(key) for key in _SHARED))
            session = Session(session.folder, _merged(session.terminal, late, given_color=context.params.get("color")))
            with exit_on_error(session.terminal):
                function(session, **given)

        parameters = list(inspect.signature(function, eval_str=True).parameters.values())[1:]
        shared = [
            inspect.Parameter(key, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=annotation)
            for key, (annotation, default) in _SHARED.items()
        ]
        context = inspect.Parameter("context", inspect.Parameter.POSITIONAL_OR_KEYWORD, annotation=typer.Context)
        own = [parameter.replace(kind=inspect.Parameter.KEYWORD_ONLY) for parameter in parameters]
        signature = inspect.Signature([context, *own, *shared])
        run.__signature__ = signature  # type: ignore[attr-defined]
        run.__annotations__ = {each.name: each.annotation for each in signature.parameters.values()}
        app.command(name)(run)
        return run

    return register


_SHARED: dict[str, tuple[Any, Any]] = {
    "quiet": (Quiet, False),
    "verbose": (Verbose, False),
    "json": (Json, False),
    "color": (Color, None),
    "threads": (Threads, None),
}


def _merged(first: Terminal, late: Terminal, given_color: object) -> Terminal:
    """Return the options of both places; the later one wins."""
    return Terminal(
        quiet=first.quiet or late.quiet,
        verbose=first.verbose or late.verbose,
        json=first.json or late.json,
        color=late.color if given_color is not None else first.color,
        threads=late.threads if late.threads != 1 else first.threads,
    )
