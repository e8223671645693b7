"""`orip solve`."""

from __future__ import annotations

from typing import Annotated

import typer

from orip.cli.options import Session, command
from orip.cli.solving import exit_code, limited_threads, solve_watcher, tell_solution

BundleArgument = Annotated[
    str | None, typer.Argument(metavar="BUNDLE", help="Needed only where the project has several.")
]


def register(app: typer.Typer) -> None:
    """Add the command."""

    @command(app, "solve")
    def solve_command(session: Session, bundle: BundleArgument = None) -> None:
        """Adjust a bundle; write result.json, residuals.csv, BUNDLE_RESULT.OUT and BUNDLE_ERROR.OUT.

        Ctrl-C stops after the iteration in hand and keeps its result, marked as stopped.

        Example: orip solve --json > result.json
        """
        from orip.files.result_json import result_text
        from orip.workflow.solve import solve

        terminal = session.terminal
        with limited_threads(terminal):
            outcome = solve(session.folder, bundle, solve_watcher(terminal))
        tell_solution(terminal, outcome)
        if terminal.json:
            terminal.data(result_text(outcome.solution))
        raise typer.Exit(exit_code(outcome.solution))
