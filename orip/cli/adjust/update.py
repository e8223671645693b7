"""`orip update`."""

from __future__ import annotations

from dataclasses import asdict
from functools import partial
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from orip.cli.completion import of_results
from orip.cli.options import BundleOption, Invocation, command
from orip.cli.terminal import Terminal, warning_rows

if TYPE_CHECKING:
    from orip.solving.updated_values import ChangedValue
    from orip.workflow.adjust.update import UpdateOutcome

What = Annotated[
    Literal["cameras", "photos", "points"], typer.Argument(metavar="WHAT", help="cameras, photos or points.")
]
Names = Annotated[
    list[str] | None,
    typer.Argument(metavar="NAME", autocompletion=of_results, help="Only these; default: all of the adjustment."),
]
ForceOption = Annotated[bool, typer.Option("--force", help="Also from an adjustment that did not converge.")]

_SHOWN_KEPT = 10


def register(app: typer.Typer) -> None:
    """Add the command."""

    @command(app, "update")
    def update_command(
        invocation: Invocation, what: What, names: Names = None, bundle: BundleOption = None, force: ForceOption = False
    ) -> None:
        """Take values of the last adjustment as preliminary values, but only those of its unknowns.

        Cameras and photos change in their stores and stay so until their text in orip.toml changes. Points go into
        BUNDLE.PRE; points in it that the adjustment does not have stay.

        Example: orip update photos st1 st2
        """
        from orip.workflow.adjust.update import UPDATED_FROM, update
        from orip.workflow.project.bundle_state import read_bundle
        from orip.workflow.project.commit import carry_out

        given = read_bundle(invocation.folder, bundle, *UPDATED_FROM)
        outcome = carry_out(given, partial(update, what=what, names=names or (), force=force)).outcome
        tell(invocation.terminal, outcome)
        if invocation.terminal.json:
            invocation.terminal.document(
                {
                    "command": "update",
                    "what": outcome.what,
                    "bundle": outcome.bundle,
                    "run": outcome.run,
                    "file": outcome.project.shown(outcome.path),
                    "unchanged": not outcome.changed,
                    "changed": list(outcome.changed),
                    "changes": [asdict(change) for change in outcome.values],
                    "kept": [asdict(value) for value in outcome.kept],
                    "antennas": [asdict(value) for value in outcome.antennas],
                    "constant": outcome.constant,
                    "others": outcome.others,
                    "warnings": warning_rows(outcome.warnings),
                }
            )


def tell(terminal: Terminal, outcome: UpdateOutcome) -> None:
    """Say which preliminary values are new, and which unknowns kept theirs."""
    terminal.warn(outcome.warnings)
    shown = outcome.project.shown(outcome.path)
    source = f"the adjustment of {outcome.bundle}"
    if outcome.changed:
        terminal.say(f"update   {shown}: {len(outcome.changed)} of {outcome.considered} {outcome.what} have new values")
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
