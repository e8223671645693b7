"""`orip run`, `orip status`, and `orip` alone."""

from __future__ import annotations

import os
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from orip.annexes import DRIVE_WORDS, annex
from orip.cli import new as init
from orip.cli import observations as measure
from orip.cli.completion import bundles
from orip.cli.method import AllPhotos, MethodOptions, exit_code, solve_watcher, tell_solution
from orip.cli.options import LINK_VARIABLE, Invocation, command
from orip.cli.results import Pictures, Report, tell_report
from orip.cli.terminal import Terminal, warning_rows
from orip.threads import limited_threads

if TYPE_CHECKING:
    from orip.errors import ProjectWarning
    from orip.workflow.records.reconcile import Prefer
    from orip.workflow.run import RunSettings


Shown = Literal["all", "no pictures", "no report"]

OneBundle = Annotated[
    str | None, typer.Argument(metavar="BUNDLE", autocompletion=bundles, help="Adjust this bundle only; default: all.")
]


def register(app: typer.Typer) -> None:
    """Add the command."""
    _register_status(app)

    @command(app, "run")
    def run_command(
        invocation: Invocation,
        options: MethodOptions,
        bundle: OneBundle = None,
        prefer: init.PreferOption = None,
        all_photos: AllPhotos = False,
        report: Report = True,
        pictures: Pictures = True,
    ) -> None:
        """Do the whole project: init, measure, preliminary values, solve all bundles, drive tables, reports.

        All text files are checked before anything is written. With --json: result.json, or those of all bundles.

        Example: orip -C zurich_city_hall run
        """
        from orip.workflow.run import RunSettings

        settings = RunSettings(bundle, options.method(), tuple(options.check or ()))
        shown: Shown = "no report" if not report else "all" if pictures else "no pictures"
        raise typer.Exit(
            run_project(invocation.terminal, invocation.folder, settings, prefer, all_photos=all_photos, shown=shown)
        )


def run_project(
    terminal: Terminal,
    folder: Path,
    settings: RunSettings | None = None,
    prefer: Prefer | None = None,
    *,
    all_photos: bool = False,
    shown: Shown = "all",
) -> int:
    """Do all that `orip run` does in a folder, and return the exit code."""
    from orip.files.result.json_text import result_document, result_text
    from orip.workflow.adjust.report import REPORTED_FROM, report_of
    from orip.workflow.project.commit import commit
    from orip.workflow.project.state import read_project
    from orip.workflow.records.initialise import INITIALISED_FROM
    from orip.workflow.run import EVERYTHING, RunWatcher, run

    watcher = RunWatcher(
        initialised=partial(init.tell, terminal),
        measured=partial(measure.tell, terminal),
        solving=solve_watcher(terminal),
        solved=partial(tell_solution, terminal),
        driven=partial(_tell_drive, terminal),
        processed=partial(_tell_processed, terminal),
    )
    with limited_threads(terminal.threads):
        state = read_project(folder, *INITIALISED_FROM)
        outcomes = run(state, prefer, watcher, settings or EVERYTHING)
    if shown != "no report" and outcomes:
        state = state.read_again(*REPORTED_FROM)
        for outcome in outcomes:
            reported = report_of(state, outcome.solution, outcome.gates, pictures=shown == "all")
            tell_report(terminal, commit(reported).outcome)
    solutions = [outcome.solution for outcome in outcomes]
    if terminal.json and len(solutions) == 1:
        terminal.data(result_text(solutions[0]))
    elif terminal.json:
        terminal.document("results", {"command": "run", "results": [result_document(one) for one in solutions]})
    return max((exit_code(outcome, all_wanted=all_photos) for outcome in outcomes), default=0)


def _tell_processed(terminal: Terminal, label: str, text: str, warnings: tuple[ProjectWarning, ...]) -> None:
    terminal.point(label, text)
    terminal.warn(warnings)


def _tell_drive(terminal: Terminal, made: Any) -> None:
    annex(DRIVE_WORDS).tell_made(terminal, made)  # few bundles have models


LinkOption = Annotated[
    str | None, typer.Option("--link", metavar="URL", help=f"Ask this plate processor too; default: {LINK_VARIABLE}.")
]


def _register_status(app: typer.Typer) -> None:
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
    from orip.workflow.open_screen import open_screen
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
    if page := open_screen(found.project.folder):
        where = f"{page}report leads to the images" if terminal.is_terminal else "open; a terminal is told the address"
        terminal.data(f"screen   {where}")
    if terminal.verbose:
        terminal.data(f"loop     {observation_loop()}")
