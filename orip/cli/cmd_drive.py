"""`orip drive`: the oriented block and the plate processor."""

from __future__ import annotations

from typing import Annotated

import typer

from orip.cli.options import Invocation, command
from orip.cli.terminal import warning_rows

BundleArgument = Annotated[
    str | None, typer.Argument(metavar="BUNDLE", help="Needed only where the project has several.")
]

_ABOUT = "Drive in the oriented block: the drive table and the plate processor.\n\nExample: orip drive table"

drive = typer.Typer(name="drive", help=_ABOUT, no_args_is_help=True)


def register(app: typer.Typer) -> None:
    """Add the group of commands."""
    app.add_typer(drive)


@command(drive, "table")
def table_command(invocation: Invocation, bundle: BundleArgument = None) -> None:
    """Write BUNDLE.DRV, what a plate processor needs to drive from model to model.

    Orientations are those of the last adjustment, with the interior orientation that is in force now.

    Example: orip drive table
    """
    from orip.workflow.drive_table import write_drive_table

    outcome = write_drive_table(invocation.folder, bundle)
    terminal, table = invocation.terminal, outcome.table
    shown = outcome.project.shown(outcome.path)
    terminal.warn(outcome.warnings)
    counts = {"cameras": len(table.cameras), "photos": len(table.photos), "models": len(table.models)}
    what = ", ".join(f"{number} {name if number != 1 else name[:-1]}" for name, number in counts.items())
    terminal.say(f"drive table  {shown} {'written' if outcome.changed else 'is unchanged'}: {what}", "green")
    if terminal.json:
        document = {"command": "drive table", "file": shown, "changed": outcome.changed, **counts}
        terminal.document({**document, "start": list(table.start), "warnings": warning_rows(outcome.warnings)})
