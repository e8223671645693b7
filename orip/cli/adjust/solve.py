"""`orip solve`."""

from __future__ import annotations

from typing import Annotated, Literal

import typer

from orip.cli.adjust.progress import AllPhotos, exit_code, limited_threads, solve_watcher, tell_solution
from orip.cli.adjust.report import Report, tell_report
from orip.cli.options import BundleArgument, Invocation, command
from orip.errors import UsageError

Snoop = Annotated[
    bool, typer.Option("--snoop", help="Search for blunders and leave them out, instead of reducing weights.")
]
Sigma0 = Annotated[
    Literal["apriori", "posteriori"] | None,
    typer.Option("--sigma0", help="With --snoop: sigma0 is 1 (apriori, default), or estimated (posteriori)."),
]
Alpha = Annotated[
    float | None,
    typer.Option(
        "--alpha",
        min=1e-9,
        max=0.5,
        help="With --snoop: error probability of one test (default: 0.05 of all together).",
    ),
]
Prune = Annotated[
    bool, typer.Option("--prune", help="Hold camera parameters that are not significant at zero, one after the other.")
]
VarianceComponents = Annotated[
    bool,
    typer.Option(
        "--variance-components",
        help="Estimate the a-priori error of each group of observations, and adjust with these errors.",
    ),
]
Check = Annotated[
    list[str] | None,
    typer.Option("--check", metavar="EXPR", help="A gate such as 'sigma0<=1.5'; exit code 5 if it fails. Repeatable."),
]


def register(app: typer.Typer) -> None:
    """Add the command."""

    @command(app, "solve")
    def solve_command(
        invocation: Invocation,
        bundle: BundleArgument = None,
        snoop: Snoop = False,
        sigma0: Sigma0 = None,
        alpha: Alpha = None,
        prune: Prune = False,
        variance_components: VarianceComponents = False,
        check: Check = None,
        all_photos: AllPhotos = False,
        report: Report = True,
    ) -> None:
        """Adjust a bundle; write result.json, residuals.csv, BUNDLE_RESULT.OUT, BUNDLE_ERROR.OUT and report.html.

        Ctrl-C stops after the current iteration and keeps its result, marked as stopped.

        Example: orip solve --snoop --sigma0 posteriori
        """
        from orip.bundle.methods import Method
        from orip.bundle.snooping.search import SnoopingSettings
        from orip.files.result.json_text import result_text
        from orip.workflow.adjust.report import report_of
        from orip.workflow.adjust.solve import ADJUSTED_FROM, solve
        from orip.workflow.project.bundle_state import read_bundle
        from orip.workflow.project.commit import commit

        if not snoop and (sigma0 is not None or alpha is not None):
            message = "--sigma0 and --alpha need --snoop; add --snoop, or leave them out"
            raise UsageError(message)
        snooping = SnoopingSettings(sigma0 or "apriori", alpha) if snoop else None
        method = Method(snooping, prune, variance_components)
        terminal = invocation.terminal
        with limited_threads(terminal):
            given = read_bundle(invocation.folder, bundle, *ADJUSTED_FROM)
            solved = commit(solve(given, solve_watcher(terminal), method, check or ()))
        tell_solution(terminal, solved)
        outcome = solved.outcome
        if report:
            tell_report(terminal, commit(report_of(given.state, outcome.solution, outcome.gates)).outcome)
        if terminal.json:
            terminal.data(result_text(outcome.solution))
        raise typer.Exit(exit_code(outcome, all_wanted=all_photos))
