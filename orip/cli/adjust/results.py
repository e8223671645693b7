"""`orip results`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Literal

import typer

from orip.cli.completion import of_results
from orip.cli.options import BundleOption, ForceOption, Invocation, command
from orip.errors import UsageError
from orip.threads import limited_threads

What = Annotated[
    Literal["cameras", "photos", "points", "theodolites", "residuals", "covariance"],
    typer.Argument(
        metavar="WHAT", help="cameras, photos, points, theodolites, residuals or covariance of the last adjustment."
    ),
]
Names = Annotated[
    list[str] | None,
    typer.Argument(metavar="NAME", autocompletion=of_results, help="Only these cameras, photos, points or sets."),
]

Output = Annotated[
    Path | None,
    typer.Option("--output", "-o", metavar="FILE", help="With covariance or residuals: a file in .npz or .csv."),
]


def register(app: typer.Typer) -> None:
    """Add the command."""

    @command(app, "results")
    def results_command(
        invocation: Invocation,
        what: What,
        names: Names = None,
        output: Output = None,
        bundle: BundleOption = None,
        force: ForceOption = False,
    ) -> None:
        """Show cameras, photos, points, theodolites (zero directions) or residuals of the last adjustment.

        The covariance matrix of cameras, photos and points is written to a file; for it the adjustment is computed
        again. With --output all residuals are written to a file, with their reliability.

        Example: orip results photos st1 st2
        """
        from orip.workflow.adjust.results import results, write_residuals
        from orip.workflow.project.bundle_state import read_bundle

        if what == "covariance":
            _write_covariance(invocation, names or (), output, bundle, force=force)
            return
        if output is not None and (what != "residuals" or names):
            message = (
                "--output is for 'orip results covariance' and for all residuals, 'orip results residuals'; redirect "
                "other results with > FILE"
            )
            raise UsageError(message)
        given = read_bundle(invocation.folder, bundle, "solutions")
        solution = given.adjusted
        if output is not None:
            write_residuals(given.project, solution, invocation.folder / output, force=force)
            invocation.terminal.say(f"wrote    {output}: {len(solution.residuals.kind)} residuals")
            return
        shown = results(solution, what, names or ())
        if invocation.terminal.json:
            invocation.terminal.document("result-part", shown.document)
        else:
            invocation.terminal.tables(shown.text)


def _write_covariance(
    invocation: Invocation, names: Sequence[str], output: Path | None, bundle: str | None, *, force: bool
) -> None:
    from orip.workflow.adjust.covariance import covariance_matrix, require_format, write_covariance
    from orip.workflow.adjust.solve import ADJUSTED_FROM
    from orip.workflow.project.bundle_state import read_bundle

    path, terminal = require_format(output), invocation.terminal
    with limited_threads(terminal.threads):
        given = read_bundle(invocation.folder, bundle, *ADJUSTED_FROM, "solutions")
        matrix = covariance_matrix(given, names)
    write_covariance(given.project, matrix, invocation.folder / path, force=force)
    if terminal.json:
        figures = len(matrix.names)
        terminal.document(
            "covariance", {"command": "results covariance", "run": matrix.run, "file": str(path), "figures": figures}
        )
    terminal.say(f"wrote    {path}: covariances of {len(matrix.names)} figures")
