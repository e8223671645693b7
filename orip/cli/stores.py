"""`orip dump`, `orip load` and `orip export-toml`: the record stores as text and back."""

from __future__ import annotations

import io
import sys
from pathlib import Path
from typing import Annotated

import typer

from orip.cli.options import Invocation, command
from orip.cli.terminal import warning_rows

StoreArgument = Annotated[Path, typer.Argument(metavar="STORE", help="A .CAM .TIK .PHO .TEM .EXT or .EXO file.")]
TextArgument = Annotated[Path | None, typer.Argument(metavar="TEXT", help="A dump; none or '-': stdin.")]


def register(app: typer.Typer) -> None:
    """Add the commands."""
    _register_export(app)

    @command(app, "dump", reads_only=True)
    def dump_command(invocation: Invocation, store: StoreArgument) -> None:
        """Print a record store as canonical text: equal data give equal text.

        Example: orip dump ZURICH.PHO > photos.txt
        """
        from orip.errors import InputError
        from orip.files.stores.dump import dump

        path = invocation.folder / store
        if not path.is_file():
            message = "there is no such store; 'orip init' and 'orip measure' make the stores of a project"
            raise InputError.single(message, str(store))
        for line in dump(path):
            invocation.terminal.data(line)

    @command(app, "load")
    def load_command(invocation: Invocation, store: StoreArgument, text: TextArgument = None) -> None:
        """Replace a record store's content by that of a dump, all or nothing.

        Example: orip load ZURICH.PHO photos.txt
        """
        from orip.errors import InputError
        from orip.files.stores.dump import load
        from orip.files.text.regular_file import open_regular

        if text is None or str(text) == "-":
            load(sys.stdin, invocation.folder / store, source="stdin")
        else:
            path = invocation.folder / text
            if not path.is_file():
                message = "there is no such file; name a text that 'orip dump' printed"
                raise InputError.single(message, str(text))
            with io.TextIOWrapper(open_regular(path), encoding="utf-8", errors="replace", newline="") as lines:
                load(lines, invocation.folder / store, source=str(text))
        invocation.terminal.say(f"load     {store} holds what the dump says")


OutputOption = Annotated[
    Path | None, typer.Option("--output", "-o", metavar="FILE", help="Output file; default: stdout.")
]
ForceOption = Annotated[bool, typer.Option("--force", help="Also over another text, which is kept as FILE.bak.")]


def _register_export(app: typer.Typer) -> None:
    """Add the command."""

    @command(app, "export-toml")
    def export_command(invocation: Invocation, output: OutputOption = None, force: ForceOption = False) -> None:
        """Bring the record stores into the text: a complete orip.toml.

        Records that are as the stores hold them keep their lines and comments. 'orip init' then has nothing to do.

        Example: orip export-toml --output orip.toml --force
        """
        from orip.workflow.project.commit import commit
        from orip.workflow.project.state import read_project
        from orip.workflow.records.initialise import export_toml

        path = invocation.folder / output if output is not None else None
        outcome = commit(export_toml(read_project(invocation.folder, "definitions"), path, force=force)).outcome
        terminal, shown = invocation.terminal, outcome.project.shown
        terminal.warn(outcome.warnings)
        if outcome.path is not None and outcome.changed:
            terminal.say(f"wrote    {shown(outcome.path)}")
        elif outcome.path is not None:
            terminal.say(f"export   unchanged: {shown(outcome.path)} says what the stores hold")
        if outcome.backup is not None:
            terminal.say(f"kept     the old text as {shown(outcome.backup)}")
        if terminal.json:
            terminal.document(
                "export-toml",
                {
                    "command": "export-toml",
                    "file": None if outcome.path is None else shown(outcome.path),
                    "backup": None if outcome.backup is None else shown(outcome.backup),
                    "unchanged": not outcome.changed,
                    "text": outcome.text,
                    "warnings": warning_rows(outcome.warnings),
                },
            )
        elif outcome.path is None:
            terminal.data(outcome.text)
