"""The program `orip`: its commands, and what it says without one."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from orip import __version__
from orip.cli import cmd_init, cmd_measure, cmd_results, cmd_run, cmd_solve, cmd_status, cmd_stores
from orip.cli.exits import exit_on_error
from orip.cli.options import Color, Json, Quiet, Session, Threads, Verbose, first_options

app = typer.Typer(
    name="orip",
    invoke_without_command=True,
    no_args_is_help=False,
    add_completion=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)

for module in (cmd_init, cmd_measure, cmd_solve, cmd_run, cmd_status, cmd_results, cmd_stores):
    module.register(app)


def _print_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"orip {__version__}")
        raise typer.Exit


@app.callback()
def before_command(
    context: typer.Context,
    folder: Annotated[Path, typer.Option("--project", "-C", metavar="DIR", help="The project folder.")] = Path(),
    quiet: Quiet = False,
    verbose: Verbose = False,
    json: Json = False,
    color: Color = None,
    threads: Threads = None,
    _version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version and exit.")
    ] = False,
) -> None:
    """Bundle adjustment of photogrammetric project folders.

    Without a command: what the project has, and what is next.
    """
    terminal = first_options(quiet, verbose, json, color, threads)
    context.obj = Session(folder, terminal)
    if context.invoked_subcommand is None:
        with exit_on_error(terminal):
            cmd_status.show(context.obj)


def main() -> None:
    """Run the program."""
    app()


if __name__ == "__main__":
    main()
