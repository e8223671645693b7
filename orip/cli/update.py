"""`orip update`."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Annotated, Literal, TypeAlias

import typer
from msgspec.structs import asdict

from orip.cli.completion import of_results
from orip.cli.options import BundleOption, DryRunOption, Invocation, command
from orip.cli.terminal import Terminal, warning_rows
from orip.errors import UsageError
from orip.wording import first_names

if TYPE_CHECKING:
    from orip.solving.updated_values import ChangedValue
    from orip.workflow.adjust.update import UpdateOutcome


Kind: TypeAlias = Literal["cameras", "photos", "points"]

What = Annotated[Kind | None, typer.Argument(metavar="WHAT", help="cameras, photos or points.")]
Names = Annotated[
    list[str] | None,
    typer.Argument(metavar="NAME", autocompletion=of_results, help="Only these; default: all of the adjustment."),
]
ForceOption = Annotated[bool, typer.Option("--force", help="Also from an adjustment that did not converge.")]

UndoOption = Annotated[bool, typer.Option("--undo", help="Undo the last update, as long as nothing changed since.")]

_SHOWN_KEPT = 10


def register(app: typer.Typer) -> None:
    """Add the command."""

    @command(app, "update")
    def update_command(
        invocation: Invocation,
        what: What = None,
        names: Names = None,
        bundle: BundleOption = None,
        force: ForceOption = False,
        dry_run: DryRunOption = False,
        undo: UndoOption = False,
    ) -> None:
        """Take values of the last adjustment as preliminary values, but only those of its unknowns.

        Cameras and photos change in their stores and stay so until their text in orip.toml changes. Points go into
        BUNDLE.PRE; points in it that the adjustment does not have stay. The last update can be undone.

        Example: orip update photos st1 st2
        """
        if undo:
            _undo(invocation, what, dry_run=dry_run)
        elif what is None:
            message = "say what to update: cameras, photos or points; or --undo for the last update"
            raise UsageError(message)
        else:
            _update(invocation, what, names or [], bundle, force=force, dry_run=dry_run)


def _update(
    invocation: Invocation, what: Kind, names: list[str], bundle: str | None, *, force: bool, dry_run: bool
) -> None:
    from orip.workflow.adjust.update import UPDATED_FROM, update
    from orip.workflow.project.bundle_state import read_bundle
    from orip.workflow.project.commit import carry_out

    given = read_bundle(invocation.folder, bundle, *UPDATED_FROM)
    command = partial(update, what=what, names=names, force=force)
    outcome = command(given).outcome if dry_run else carry_out(given, command).outcome
    tell(invocation.terminal, outcome, dry_run=dry_run)
    if invocation.terminal.json:
        invocation.terminal.document(
            "update",
            {
                "command": "update",
                "what": outcome.what,
                "bundle": outcome.bundle,
                "run": outcome.run,
                "file": outcome.project.shown(outcome.path),
                "dry_run": dry_run,
                "unchanged": not outcome.changed,
                "changed": list(outcome.changed),
                "changes": [asdict(change) for change in outcome.values],
                "kept": [asdict(value) for value in outcome.kept],
                "antennas": [asdict(value) for value in outcome.antennas],
                "constant": outcome.constant,
                "others": outcome.others,
                "warnings": warning_rows(outcome.warnings),
            },
        )


def _undo(invocation: Invocation, what: Kind | None, *, dry_run: bool) -> None:
    from orip.workflow.adjust.undo_update import UNDONE_FROM, undo_update
    from orip.workflow.project.commit import carry_out
    from orip.workflow.project.state import read_project

    if what is not None:
        message = f"--undo undoes the last update, whatever it was of; leave out '{what}'"
        raise UsageError(message)
    state = read_project(invocation.folder, *UNDONE_FROM)
    outcome = undo_update(state).outcome if dry_run else carry_out(state, undo_update).outcome
    shown = outcome.project.shown(outcome.path)
    if outcome.names:
        has = "would have" if dry_run else "has"
        named = "" if outcome.what == "points" else f": {first_names(outcome.names, 12)}"
        text = f"update   {shown} {has} the {outcome.what} of before the last update{named}"
    else:
        text = f"update   unchanged: {shown} holds the {outcome.what} of before the last update already"
    document = {
        "command": "update",
        "what": outcome.what,
        "bundle": outcome.bundle,
        "file": shown,
        "dry_run": dry_run,
        "undone": list(outcome.names),
    }
    if invocation.terminal.json:
        invocation.terminal.document("update-undone", document)
    invocation.terminal.say(text)


def tell(terminal: Terminal, outcome: UpdateOutcome, *, dry_run: bool = False) -> None:
    """Say which preliminary values are new, and which unknowns kept theirs."""
    terminal.warn(outcome.warnings)
    shown = outcome.project.shown(outcome.path)
    source = f"the adjustment of {outcome.bundle}"
    if outcome.changed:
        have = "would have" if dry_run else "have"
        counts = f"{len(outcome.changed)} of {outcome.considered} {outcome.what}"
        terminal.say(f"update   {shown}: {counts} {have} new values" + ("; nothing is written" if dry_run else ""))
    elif outcome.constant == outcome.considered:
        terminal.say(f"update   unchanged: {source} has no unknown of these {outcome.what}")
    else:
        terminal.say(f"update   unchanged: {shown} holds the values of {source} already")
    _tell_values(terminal, outcome)
    if outcome.constant and outcome.changed:
        terminal.say(f"         constant in {source}, and left as they are: {outcome.constant} {outcome.what}")
    for value in outcome.kept[:_SHOWN_KEPT]:
        terminal.say(f"kept     {outcome.what[:-1]} {value.name} {value.parameter}: {value.reason}", "yellow")
    if (more := len(outcome.kept) - _SHOWN_KEPT) > 0:
        terminal.say(f"         and {more} more; --json lists all")
    for value in outcome.antennas:
        terminal.say(f"kept     antenna {value.name} {value.parameter}: {value.reason}", "yellow")
    if outcome.others:
        terminal.say(f"kept     {outcome.others} points of {shown} that {source} does not have")


def _tell_values(terminal: Terminal, outcome: UpdateOutcome) -> None:
    """Show new values: of cameras, which are few, always."""
    by_name: dict[str, list[ChangedValue]] = {}
    for change in outcome.values:
        by_name.setdefault(change.name, []).append(change)
    for name, values in by_name.items():
        listed = ", ".join(f"{change.parameter} {_number(change.old)} -> {_number(change.new)}" for change in values)
        line = f"         {outcome.what[:-1]} {name}: {listed}"
        if outcome.what == "cameras":
            terminal.say(line)
        else:
            terminal.detail(line)


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.9g}"
