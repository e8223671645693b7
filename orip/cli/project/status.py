"""`orip status`, and `orip` alone."""

from __future__ import annotations

import os
from typing import Annotated

import typer

from orip.cli.options import LINK_VARIABLE, Invocation, command
from orip.cli.terminal import warning_rows

LinkOption = Annotated[
    str | None, typer.Option("--link", metavar="URL", help=f"Ask this plate processor too; default: {LINK_VARIABLE}.")
]


def register(app: typer.Typer) -> None:
    """Add the command."""

    @command(app, "status", reads_only=True)
    def status(invocation: Invocation, link: LinkOption = None) -> None:
        """Show what the project has, what is out of date, and what comes next. Reads only.

        With --link, or ORIP_LINK where that answers, also whether that plate processor has the drive table.

        Example: orip status
        """
        show(invocation, link)


def show(invocation: Invocation, link: str | None = None) -> None:
    """Print the state of the project on stdout."""
    from orip.workflow.project.state import read_project
    from orip.workflow.status import STATUS_FROM, observation_loop, project_status

    processor = link or os.environ.get(LINK_VARIABLE) or None
    found = project_status(read_project(invocation.folder, *STATUS_FROM), processor, is_there=link is not None)
    terminal = invocation.terminal
    if terminal.json:
        terminal.document(
            "status",
            {
                "command": "status",
                "project": found.project.definition.name,
                "user": found.project.definition.user,
                "counts": {f"{name}s": count for name, count in found.counts},
                "steps": [{"command": step.command, "state": step.state, "text": step.text} for step in found.steps],
                "next": found.next_command,
                "warnings": warning_rows(found.warnings),
            },
        )
        return
    terminal.warn(found.warnings)
    has = ", ".join(f"{count} {name}{'s' * (count != 1)}" for name, count in found.counts)
    user = f" ({found.project.definition.user})" if found.project.definition.user else ""
    terminal.data(f"project  {found.project.definition.name}{user}: {has}")
    width = max(len(step.command) for step in found.steps)
    for step in found.steps:
        terminal.data(f"{step.command:{width}}  {step.state:11}  {step.text}")
    untouched = all(step.state == "missing" for step in found.steps)
    if found.next_command is None:
        terminal.data("next     nothing: everything is up to date")
    else:
        terminal.data(f"next     {'orip run  (or step by step: orip init)' if untouched else found.next_command}")
    if terminal.verbose:
        terminal.data(f"loop     {observation_loop()}")
