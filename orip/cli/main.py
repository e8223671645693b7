"""The program `orip`: its commands, and what it says without one."""

from __future__ import annotations

import os
import sys
from contextlib import suppress
from pathlib import Path
from typing import Annotated

import typer

from orip.cli.commands import Commands
from orip.cli.exits import exit_on_error, report, report_usage, warnings_kept_back
from orip.cli.options import Color, Invocation, Json, Quiet, SharedOptions, Threads, Verbose
from orip.cli.terminal import Terminal, output_taken
from orip.errors import INTERRUPTED, OripError
from orip.version import __version__

app = typer.Typer(
    name="orip",
    cls=Commands,
    invoke_without_command=True,
    no_args_is_help=False,
    add_completion=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _print_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"orip {__version__}")
        raise typer.Exit


@app.callback()
def before_command(
    context: typer.Context,
    folder: Annotated[
        Path,
        typer.Option(
            "--project", "-C", metavar="DIR", help="The project folder: work as if started there (file names too)."
        ),
    ] = Path(),
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

    Example: orip init --sample small_frame_block; orip -C small_frame_block run
    """
    options = SharedOptions(quiet, verbose, json, color, threads)
    context.obj = Invocation(folder, options, options.terminal())
    if context.invoked_subcommand is None:
        from orip.cli.project import status

        with exit_on_error(context.obj.terminal):
            status.show(context.obj)


def main() -> None:
    """Run the program."""
    _prepare_streams()
    try:
        with output_taken(), warnings_kept_back():  # typer prints its help without a terminal of orip's
            code = app(prog_name="orip", standalone_mode=False)
            sys.stdout.flush()
    except OripError as error:
        code = report(Terminal(), error)
    except BrokenPipeError:
        code = 0
    except typer.Abort:
        code = INTERRUPTED
    except typer.TyperException as error:  # every fault of the command line that typer finds
        code = report_usage(error, sys.argv[1:])
    sys.exit(code)


def _prepare_streams() -> None:
    """Let no stream fail a command: a closed one discards its input, a full one waits, every character prints."""
    sys.stdout = sys.stdout or Path(os.devnull).open("w", encoding="utf-8")  # noqa: SIM115  # open for as long as orip runs
    sys.stderr = sys.stderr or Path(os.devnull).open("w", encoding="utf-8")  # noqa: SIM115
    for stream in (sys.stdout, sys.stderr):
        stream.reconfigure(errors="backslashreplace")  # type: ignore[union-attr]
        with suppress(OSError, ValueError):  # a pipe that does not wait for its reader would lose what it cannot take
            os.set_blocking(stream.fileno(), True)


if __name__ == "__main__":
    main()
