"""`orip report`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from orip.cli.options import BundleArgument, Invocation, command
from orip.cli.terminal import Terminal

if TYPE_CHECKING:
    from orip.workflow.adjust.report import WrittenReport

Output = Annotated[
    Path | None, typer.Option("--output", "-o", metavar="FILE", help="Output file; default: report.html.")
]


Report = Annotated[bool, typer.Option("--report/--no-report", help="Also write the report, one HTML page.")]


def tell_report(terminal: Terminal, written: WrittenReport) -> None:
    """Say where the report is."""
    terminal.say(f"wrote    {written.shown} ({written.size / 1e6:.1f} MB); open it in a browser")


def register(app: typer.Typer) -> None:
    """Add the command."""

    @command(app, "report")
    def report_command(invocation: Invocation, bundle: BundleArgument = None, output: Output = None) -> None:
        """Write the report of the last adjustment: one HTML page that needs no network.

        Example: orip report --output outcrop.html
        """
        from orip.workflow.adjust.report import report
        from orip.workflow.project.bundle_state import read_bundle
        from orip.workflow.project.commit import commit

        given = read_bundle(invocation.folder, bundle, "definitions", "solutions")
        written = commit(report(given, output)).outcome
        terminal = invocation.terminal
        if terminal.json:
            terminal.document(
                {"command": "report", "run": written.run, "bundle": written.bundle, "file": written.shown}
            )
        tell_report(terminal, written)
