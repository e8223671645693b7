"""`orip results`."""

from __future__ import annotations

from typing import Annotated, Literal

import typer

from orip.cli.completion import of_results
from orip.cli.options import BundleOption, Invocation, command

What = Annotated[
    Literal["cameras", "photos", "points", "theodolites", "residuals"],
    typer.Argument(metavar="WHAT", help="cameras, photos, points, theodolites or residuals of the last adjustment."),
]
Names = Annotated[
    list[str] | None,
    typer.Argument(metavar="NAME", autocompletion=of_results, help="Only these cameras, photos, points or sets."),
]


def register(app: typer.Typer) -> None:
    """Add the command."""

    @command(app, "results")
    def results_command(invocation: Invocation, what: What, names: Names = None, bundle: BundleOption = None) -> None:
        """Show cameras, photos, points, theodolites (zero directions) or residuals of the last adjustment.

        Example: orip results photos st1 st2
        """
        from orip.workflow.adjust.results import results
        from orip.workflow.project.bundle_state import read_bundle

        shown = results(read_bundle(invocation.folder, bundle, "solutions").adjusted, what, names or ())
        if invocation.terminal.json:
            invocation.terminal.document(shown.document)
        else:
            invocation.terminal.data(shown.text)
