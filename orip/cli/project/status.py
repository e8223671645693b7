"""`orip status`, and `orip` alone."""

from __future__ import annotations

import typer

from orip.cli.options import Invocation, command
from orip.cli.terminal import warning_rows


def register(app: typer.Typer) -> None:
    """Add the command."""

    @command(app, "status")
    def status(invocation: Invocation) -> None:
        """Show what the project has, what is out of date, and what comes next. Reads only.

        Example: orip status
        """
        show(invocation)


def show(invocation: Invocation) -> None:
    """Print the state of the project on stdout."""
    from orip.workflow.project.state import read_project
    from orip.workflow.status import STATUS_FROM, observation_loop, project_status

    found = project_status(read_project(invocation.folder, *STATUS_FROM))
    terminal = invocation.terminal
    if terminal.json:
        terminal.document(
            {
                "command": "status",
                "project": found.project.definition.name,
                "user": found.project.definition.user,
                "counts": {f"{name}s": count for name, count in found.counts},
                "steps": [{"command": step.command, "state": step.state, "text": step.text} for step in found.steps],
                "next": found.next_command,
                "warnings": warning_rows(found.warnings),
            }
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
