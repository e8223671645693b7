"""`orip report`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from orip.cli.options import Invocation, command

BundleArgument = Annotated[
    str | None, typer.Argument(metavar="BUNDLE", help="Needed only where the project has several.")
]
Output = Annotated[
    Path | None, typer.Option("--output", "-o", metavar="FILE", help="Where to; default report.html of the project.")
]


def register(app: typer.Typer) -> None:
    """Add the command."""

    @command(app, "report")
    def report_command(invocation: Invocation, bundle: BundleArgument = None, output: Output = None) -> None:
        """Write the report of the last adjustment: one HTML page that needs no network.

        Example: orip report --output outcrop.html
        """
        from orip.workflow.report import report

        written = report(invocation.folder, bundle, output)
        terminal = invocation.terminal
        if terminal.json:
            terminal.document(
                {"command": "report", "run": written.run, "bundle": written.bundle, "file": str(written.path)}
            )
        terminal.say(f"wrote    {written.path} ({written.size / 1e6:.1f} MB)")
