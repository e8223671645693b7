"""What commands that edit records and control lines have in common: options, and how they report what they did."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, NamedTuple, TypeAlias

import msgspec
import typer

from orip.cli.options import BundleOption
from orip.cli.terminal import Terminal, warning_rows

if TYPE_CHECKING:
    from orip.workflow.control.edits import ControlOutcome
    from orip.workflow.records.commands import RecordsOutcome

    EditOutcome: TypeAlias = ControlOutcome | RecordsOutcome

DryRunOption = Annotated[bool, typer.Option("--dry-run", help="Show the difference and write nothing.")]
YesOption = Annotated[bool, typer.Option("--yes", help="Do not ask for confirmation.")]


class EditOptions(NamedTuple):
    """Options of every command that edits."""

    bundle: BundleOption = None
    dry_run: DryRunOption = False


def tell_edit(terminal: Terminal, verb: str, outcome: EditOutcome, unchanged: str) -> None:
    """Say whether anything was edited, before the changes are listed; `unchanged` names what stays."""
    terminal.warn(outcome.warnings)
    if not outcome.changes:
        terminal.say(f"{verb} unchanged: {unchanged} so already")
    elif outcome.dry_run:
        terminal.say(f"{verb} would do the following; nothing is written")


def edit_document(command: str, outcome: EditOutcome, **more: Any) -> dict[str, Any]:
    """Return what an edit did, as a document for programs."""
    return {
        "command": command,
        **more,
        "unchanged": not outcome.changes,
        "dry_run": outcome.dry_run,
        "changes": msgspec.to_builtins(outcome.changes),
        "warnings": warning_rows(outcome.warnings),
    }
