"""`orip solve`."""

from __future__ import annotations

import typer

from orip.cli.adjust.cluster import ClusterOptions
from orip.cli.adjust.method import MethodOptions
from orip.cli.adjust.progress import AllPhotos, exit_code, tell_solution
from orip.cli.adjust.report import Report, tell_report
from orip.cli.options import BundleArgument, Invocation, command
from orip.threads import limited_threads


def register(app: typer.Typer) -> None:
    """Add the command."""

    @command(app, "solve")
    def solve_command(
        invocation: Invocation,
        options: MethodOptions,
        cluster: ClusterOptions,
        bundle: BundleArgument = None,
        all_photos: AllPhotos = False,
        report: Report = True,
    ) -> None:
        """Adjust a bundle; write result.json, residuals.csv, BUNDLE_RESULT.OUT, BUNDLE_ERROR.OUT and report.html.

        Ctrl-C stops after the current iteration and keeps its result, marked as stopped.

        Example: orip solve --snoop --sigma0 posteriori

        With --dask the normal equations are divided among the workers of a cluster: for blocks of many thousand photos.
        """
        from orip.files.result.json_text import result_text
        from orip.workflow.adjust.report import REPORTED_FROM, report_of
        from orip.workflow.adjust.solve import ADJUSTED_FROM, solve
        from orip.workflow.project.bundle_state import read_bundle
        from orip.workflow.project.commit import commit

        method, terminal = options.method(), invocation.terminal
        with cluster.columns_set_aside(invocation.folder):
            with limited_threads(terminal.threads):
                given = read_bundle(invocation.folder, bundle, *ADJUSTED_FROM)
                with cluster.posing(terminal, given.project.folder) as (pose, watcher):
                    change = solve(given, watcher, method, options.check or (), pose)
                solved = commit(change)
            tell_solution(terminal, solved)
            outcome, state = solved.outcome, given.state
            del given, change
            if report:
                reported = report_of(state.read_again(*REPORTED_FROM), outcome.solution, outcome.gates)
                tell_report(terminal, commit(reported).outcome)
            if terminal.json:
                terminal.data(result_text(outcome.solution))
        raise typer.Exit(exit_code(outcome, all_wanted=all_photos))
