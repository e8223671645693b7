"""`orip init`."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import msgspec
import typer

from orip.cli.completion import samples
from orip.cli.options import Invocation, command
from orip.cli.project.new import list_samples, tell_made, tell_sample
from orip.cli.terminal import Terminal, warning_rows
from orip.errors import UsageError

if TYPE_CHECKING:
    from orip.workflow.records.initialise import Initialised

PreferOption = Annotated[
    Literal["text", "store"] | None,
    typer.Option("--prefer", help="Which side wins where orip.toml and a store have both changed a record."),
]

SampleOption = Annotated[
    bool, typer.Option("--sample", help="Write the sample project NAME into DIR; without a name, list them.")
]
SampleName = Annotated[
    str | None,
    typer.Argument(
        metavar="NAME", autocompletion=samples, help="Make a project of that name; with --sample: which one."
    ),
]
SampleFolder = Annotated[
    Path | None, typer.Argument(metavar="DIR", help="The folder of the project that is made; default ./NAME.")
]

UserOption = Annotated[str, typer.Option("--user", help="With NAME: the operator, whose name is on all outputs.")]

_SHOWN_VALUES = 12


def register(app: typer.Typer) -> None:
    """Add the command."""

    @command(app, "init")
    def init(
        invocation: Invocation,
        name: SampleName = None,
        folder: SampleFolder = None,
        sample: SampleOption = False,
        prefer: PreferOption = None,
        user: UserOption = "",
    ) -> None:
        """Apply orip.toml to the record stores; or make a project, new or a sample. Safe to repeat.

        With NAME a project is made that commands define: 'orip camera add', 'photo add', 'bundle add' and others.

        Records whose text has not changed since the last time stay as they are, so what 'orip update' wrote survives.

        Example: orip init --sample small_frame_block try
        """
        if sample:
            _sample(invocation, name, folder, prefer)
            return
        if name is not None:
            _make(invocation, name, user, folder, prefer)
            return
        from orip.workflow.project.commit import carry_out
        from orip.workflow.project.state import read_checked_project
        from orip.workflow.records.initialise import INITIALISED_FROM, initialise

        state = read_checked_project(invocation.folder, *INITIALISED_FROM)
        outcome = carry_out(state, partial(initialise, prefer=prefer)).outcome
        tell(invocation.terminal, outcome)
        if invocation.terminal.json:
            invocation.terminal.document(
                "init",
                {
                    "command": "init",
                    "unchanged": not outcome.changes,
                    "changes": [
                        {"kind": change.kind, "name": change.name, "action": change.action}
                        for change in outcome.changes
                    ],
                    "differences": msgspec.to_builtins(outcome.differences),
                    "warnings": warning_rows(outcome.warnings),
                },
            )


def _sample(invocation: Invocation, name: str | None, folder: Path | None, prefer: str | None) -> None:
    if prefer is not None:
        message = "--prefer cannot be combined with --sample; leave one of them out"
        raise UsageError(message)
    if name is None:
        list_samples(invocation.terminal)
        return
    from orip.workflow.sample_projects import write_sample

    tell_sample(invocation.terminal, write_sample(name, invocation.folder / (folder or name)))


def _make(invocation: Invocation, name: str, user: str, folder: Path | None, prefer: str | None) -> None:
    from orip.workflow.sample_projects import SAMPLES, make_project

    if prefer is not None:
        message = "--prefer is for 'orip init' without a name; leave one of them out"
        raise UsageError(message)
    if name in SAMPLES:
        message = f"{name} is a sample: write it with 'orip init --sample {name}', or choose another name"
        raise UsageError(message)
    tell_made(invocation.terminal, make_project(name, user, invocation.folder / (folder or name)))


def tell(terminal: Terminal, outcome: Initialised) -> None:
    """Say what the stores took over."""
    terminal.warn(outcome.warnings)
    if not outcome.changes:
        terminal.say("init     unchanged: the stores hold what orip.toml says")
        return
    from orip.workflow.records.reconcile import counted_changes

    for change in outcome.changes:
        terminal.detail(f"         {change.action} {change.kind} {change.name}")
    terminal.say(f"init     {counted_changes(outcome.changes)}")
    for change in outcome.changes:
        if change.action == "detached":
            terminal.say(f"         {change.kind} {change.name} was removed from orip.toml; it stays in its store")
    _tell_differences(terminal, outcome)


def _tell_differences(terminal: Terminal, outcome: Initialised) -> None:
    """Show the values that have changed, a few of them always."""
    from orip.workflow.records.changes import shown_value

    lines = [
        f"         {record.kind} {record.name}: {value.key} {shown_value(value.old)} -> {shown_value(value.new)}"
        for record in outcome.differences
        if record.action == "changed"
        for value in record.values
    ]
    for line in lines[:_SHOWN_VALUES]:
        terminal.say(line)
    for line in lines[_SHOWN_VALUES:]:
        terminal.detail(line)
    if (more := len(lines) - _SHOWN_VALUES) > 0 and not terminal.verbose:
        terminal.say(f"         and {more} more; -v lists all")
