"""`orip measure`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from orip.cli.options import Invocation, command
from orip.cli.terminal import Terminal, warning_rows

if TYPE_CHECKING:
    from orip.workflow.observations.measure import MeasureOutcome

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
        from orip.workflow.observations.measure import measure

        outcome = measure(invocation.folder, files or ())
        tell(invocation.terminal, outcome)
        if invocation.terminal.json:
            counts = outcome.counts
            invocation.terminal.document(
                {
                    "command": "measure",
                    "unchanged": not outcome.changed,
                    "files": [outcome.project.shown(path) for path in outcome.files],
                    "templates": counts.templates,
                    "photos": counts.photos,
                    "points": dict(counts.points),
                    "remeasured": counts.remeasured,
                    "warnings": warning_rows(outcome.warnings),
                }
            )


def tell(terminal: Terminal, outcome: MeasureOutcome) -> None:
    """Say how much is measured."""
    terminal.warn(outcome.warnings)
    counts = outcome.counts
    parts = [f"{count} photo points of {bundle}" for bundle, count in counts.points]
    if counts.templates or counts.photos:
        parts.insert(0, f"{counts.templates} templates and {counts.photos} photos oriented by marks")
    if counts.remeasured:
        parts.append(f"{counts.remeasured} measured again")
    unchanged = "" if outcome.changed else "unchanged: "
    nothing = "nothing is measured yet"
    if not outcome.files:
        nothing += f": no file is called {' or '.join(outcome.project.definition.measurement_files)}"
    terminal.say(f"measure  {unchanged}{', '.join(parts) or nothing}")
    for path in outcome.files:
        terminal.detail(f"         read {outcome.project.shown(path)}")
