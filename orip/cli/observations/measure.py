"""`orip measure`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from orip.cli.options import Invocation, command
from orip.cli.terminal import Terminal, warning_rows

if TYPE_CHECKING:
    from orip.workflow.observations.measure import MeasureOutcome
    from orip.workflow.project.commit import Committed

Files = Annotated[
    list[Path] | None,
    typer.Argument(metavar="FILE", help="Read these on top of what the stores hold; none: replay the project's list."),
]


def register(app: typer.Typer) -> None:
    """Add the command."""

    @command(app, "measure")
    def measure_command(invocation: Invocation, files: Files = None) -> None:
        """Replay the measurement files into orientations and photo observations; write INTERIOR_RESULT.OUT.

        Example: orip measure
        """
        from orip.workflow.observations.measure import MEASURED_FROM, MEASURED_ON_TOP, measure, measure_on_top
        from orip.workflow.project.commit import commit
        from orip.workflow.project.state import read_project
        from orip.workflow.project.texts import read_log

        if files:
            state = read_project(invocation.folder, *MEASURED_ON_TOP)
            change = measure_on_top(state, read_log(state.project, [state.project.folder / path for path in files]))
        else:
            change = measure(read_project(invocation.folder, *MEASURED_FROM))
        measured = commit(change)
        tell(invocation.terminal, measured)
        if invocation.terminal.json:
            outcome, counts = measured.outcome, measured.outcome.counts
            invocation.terminal.document(
                "measure",
                {
                    "command": "measure",
                    "unchanged": not measured.changed,
                    "files": [outcome.project.shown(path) for path in outcome.files],
                    "templates": counts.templates,
                    "photos": counts.photos,
                    "points": dict(counts.points),
                    "remeasured": counts.remeasured,
                    "warnings": warning_rows(outcome.warnings),
                },
            )


def tell(terminal: Terminal, measured: Committed[MeasureOutcome]) -> None:
    """Say how much is measured."""
    outcome = measured.outcome
    terminal.warn(outcome.warnings)
    counts = outcome.counts
    parts = [f"{count} photo points of {bundle}" for bundle, count in counts.points]
    if counts.templates or counts.photos:
        parts.insert(0, f"{counts.templates} templates and {counts.photos} photos oriented by marks")
    if counts.remeasured:
        parts.append(f"{counts.remeasured} measured again")
    unchanged = "" if measured.changed else "unchanged: "
    nothing = "nothing is measured yet"
    if not outcome.files:
        nothing += f": no file is called {' or '.join(outcome.project.definition.measurement_files)}"
    terminal.say(f"measure  {unchanged}{', '.join(parts) or nothing}")
    for path in outcome.files:
        terminal.detail(f"         read {outcome.project.shown(path)}")
