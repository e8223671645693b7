"""`orip drive`: the oriented block and the plate processor."""

from __future__ import annotations

from typing import TYPE_CHECKING

import typer

from orip.cli.drive import emulator, link, panel
from orip.cli.options import BundleArgument, Invocation, command, group_of_commands
from orip.cli.terminal import Terminal, warning_rows
from orip.errors import InputError, ProjectWarning
from orip.wording import counted

if TYPE_CHECKING:
    from orip.workflow.drive.table import DriveTableOutcome

_ABOUT = "Drive in the oriented block: the drive table and the plate processor.\n\nExample: orip drive table"

drive = group_of_commands("drive", _ABOUT, no_args_is_help=True)


def register(app: typer.Typer) -> None:
    """Add the group of commands."""
    link.register(drive)
    panel.register(drive)
    emulator.register(drive)
    app.add_typer(drive)


@command(drive, "table")
def table_command(invocation: Invocation, bundle: BundleArgument = None) -> None:
    """Write BUNDLE.DRV, what a plate processor needs to drive from model to model.

    Orientations are those of the last adjustment, with the interior orientation that is in force now.

    Example: orip drive table
    """
    from orip.workflow.drive.table import DRIVEN_FROM, make_drive_table
    from orip.workflow.project.bundle_state import read_bundle
    from orip.workflow.project.commit import commit

    outcome = commit(make_drive_table(read_bundle(invocation.folder, bundle, *DRIVEN_FROM))).outcome
    tell_table(invocation.terminal, outcome)
    if invocation.terminal.json:
        document = {
            "command": "drive table",
            "file": outcome.project.shown(outcome.path),
            "changed": outcome.changed,
            **_counts(outcome),
            "start": list(outcome.table.start),
            "warnings": warning_rows(outcome.warnings),
        }
        invocation.terminal.document("drive-table", document)


def tell_table(terminal: Terminal, outcome: DriveTableOutcome) -> None:
    """Say what the drive table holds."""
    terminal.warn(outcome.warnings)
    what = ", ".join(counted(number, name[:-1]) for name, number in _counts(outcome).items())
    state = "wrote    " if outcome.changed else "kept     "
    terminal.say(f"{state}{outcome.project.shown(outcome.path)}: {what}")


def tell_no_table(terminal: Terminal, error: InputError) -> None:
    """Say why a bundle with models has no drive table."""
    terminal.warn(
        ProjectWarning("no-drive-table", "", f"no drive table: {complaint}") for complaint in error.complaints
    )


def _counts(outcome: DriveTableOutcome) -> dict[str, int]:
    table = outcome.table
    return {"cameras": len(table.cameras), "photos": len(table.photos), "models": len(table.models)}
