"""`orip run`."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from orip.annexes import DRIVE_WORDS, annex
from orip.cli.adjust.method import MethodOptions
from orip.cli.adjust.progress import AllPhotos, exit_code, solve_watcher, tell_solution
from orip.cli.adjust.report import Report, tell_report
from orip.cli.completion import bundles
from orip.cli.observations import measure
from orip.cli.options import Invocation, command
from orip.cli.project import init
from orip.cli.terminal import Terminal
from orip.threads import limited_threads

if TYPE_CHECKING:
    from orip.workflow.records.reconcile import Prefer
    from orip.workflow.run import RunSettings

OneBundle = Annotated[
    str | None, typer.Argument(metavar="BUNDLE", autocompletion=bundles, help="Adjust this bundle only; default: all.")
]


def register(app: typer.Typer) -> None:
    """Add the command."""

    @command(app, "run")
    def run_command(
        invocation: Invocation,
        options: MethodOptions,
        bundle: OneBundle = None,
        prefer: init.PreferOption = None,
        all_photos: AllPhotos = False,
        report: Report = True,
    ) -> None:
        """Do the whole project: init, measure, preliminary values, solve all bundles, drive tables, reports.

        All text files are checked before anything is written. With --json: result.json, or those of all bundles.

        Example: orip -C zurich_city_hall run
        """
        from orip.workflow.run import RunSettings

        settings = RunSettings(bundle, options.method(), tuple(options.check or ()))
        terminal, folder = invocation.terminal, invocation.folder
        raise typer.Exit(run_project(terminal, folder, settings, prefer, all_photos=all_photos, report=report))


def run_project(
    terminal: Terminal,
    folder: Path,
    settings: RunSettings | None = None,
    prefer: Prefer | None = None,
    *,
    all_photos: bool = False,
    report: bool = True,
) -> int:
    """Do all that `orip run` does in a folder, and return the exit code."""
    from orip.files.result.json_text import result_document, result_text
    from orip.workflow.adjust.report import REPORTED_FROM, report_of
    from orip.workflow.project.commit import commit
    from orip.workflow.project.state import read_checked_project
    from orip.workflow.records.initialise import INITIALISED_FROM
    from orip.workflow.run import EVERYTHING, RunWatcher, run

    watcher = RunWatcher(
        initialised=partial(init.tell, terminal),
        measured=partial(measure.tell, terminal),
        solving=solve_watcher(terminal),
        solved=partial(tell_solution, terminal),
        driven=partial(_tell_drive, terminal),
    )
    with limited_threads(terminal.threads):
        state = read_checked_project(folder, *INITIALISED_FROM)
        outcomes = run(state, prefer, watcher, settings or EVERYTHING)
    if report and outcomes:
        state = state.read_again(*REPORTED_FROM)
        for outcome in outcomes:
            tell_report(terminal, commit(report_of(state, outcome.solution, outcome.gates)).outcome)
    solutions = [outcome.solution for outcome in outcomes]
    if terminal.json and len(solutions) == 1:
        terminal.data(result_text(solutions[0]))
    elif terminal.json:
        terminal.document("results", {"command": "run", "results": [result_document(one) for one in solutions]})
    return max((exit_code(outcome, all_wanted=all_photos) for outcome in outcomes), default=0)


def _tell_drive(terminal: Terminal, made: Any) -> None:
    annex(DRIVE_WORDS).tell_made(terminal, made)  # few bundles have models
