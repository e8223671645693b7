"""`orip export-toml`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from orip.cli.options import Invocation, command
from orip.cli.terminal import warning_rows

OutputOption = Annotated[
    Path | None, typer.Option("--output", "-o", metavar="FILE", help="Output file; default: stdout.")
]
ForceOption = Annotated[bool, typer.Option("--force", help="Also over another text, which is kept as FILE.bak.")]


def register(app: typer.Typer) -> None:
    """Add the command."""

    @command(app, "export-toml")
    def export_command(invocation: Invocation, output: OutputOption = None, force: ForceOption = False) -> None:
        """Bring the record stores into the text: a complete orip.toml.

        Records that are as the stores hold them keep their lines and comments. 'orip init' then has nothing to do.

        Example: orip export-toml --output orip.toml --force
        """
        from orip.workflow.project.commit import commit
        from orip.workflow.project.state import read_project
        from orip.workflow.records.export_toml import export_toml

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
