"""`orip results` and `orip report`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from orip.cli.completion import of_results
from orip.cli.options import BundleArgument, BundleOption, ForceOption, Invocation, command
from orip.cli.terminal import Terminal
from orip.errors import UsageError
from orip.threads import limited_threads

if TYPE_CHECKING:
    from orip.workflow.adjust.report import ReportKind, WrittenReport


What = Annotated[
    Literal["cameras", "photos", "points", "theodolites", "figures", "residuals", "covariance", "normals"],
    typer.Argument(
        metavar="WHAT",
        help="cameras, photos, points, theodolites, figures, residuals, covariance or normals of the last adjustment.",
    ),
]
Names = Annotated[
    list[str] | None,
    typer.Argument(
        metavar="NAME", autocompletion=of_results, help="Only these cameras, photos, points, sets or figures."
    ),
]

Output = Annotated[
    Path | None,
    typer.Option("--output", "-o", metavar="FILE", help="With covariance, normals or residuals: .npz, or .csv."),
]
Angles = Annotated[
    Literal["omega-phi-kappa", "alpha-zeta-kappa"],
    typer.Option("--angles", help="Of photos: those of terrestrial photos are 0 where they are upright."),
]
Unit = Annotated[Literal["degree", "gon", "radian"], typer.Option("--unit", help="Of the angles of photos.")]


def register(app: typer.Typer) -> None:
    """Add the command."""
    _register_report(app)

    @command(app, "results")
    def results_command(
        invocation: Invocation,
        what: What,
        names: Names = None,
        output: Output = None,
        angles: Angles = "omega-phi-kappa",
        unit: Unit = "degree",
        bundle: BundleOption = None,
        force: ForceOption = False,
    ) -> None:
        """Show cameras, photos, points, theodolites (zero directions), figures or residuals of the last adjustment.

        The covariance matrix of cameras, photos and points, and the normal equations, are written to a file; for them
        the adjustment is computed again. With --output all residuals are written to a file, with their reliability.

        Example: orip results photos st1 st2
        """
        from orip.workflow.adjust.results import photo_angles, results, write_residuals
        from orip.workflow.project.bundle_state import read_bundle

        if what == "covariance":
            _write_covariance(invocation, names or (), output, bundle, force=force)
            return
        if what == "normals":
            _write_normals(invocation, names or (), output, bundle, force=force)
            return
        is_usual = angles == "omega-phi-kappa" and unit == "degree"
        if not is_usual and what != "photos":
            message = "--angles and --unit are for 'orip results photos'"
            raise UsageError(message)
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
        chosen = names or ()
        shown = results(solution, what, chosen) if is_usual else photo_angles(solution, chosen, angles, unit)
        if invocation.terminal.json:
            invocation.terminal.document("result-part", shown.document)
        else:
            invocation.terminal.tables(shown.text)


def _write_normals(
    invocation: Invocation, names: Sequence[str], output: Path | None, bundle: str | None, *, force: bool
) -> None:
    from orip.workflow.adjust.results import write_normals
    from orip.workflow.adjust.solve import ADJUSTED_FROM
    from orip.workflow.project.bundle_state import read_bundle

    if names:
        message = "normal equations are those of all unknowns; leave the names away"
        raise UsageError(message)
    terminal = invocation.terminal
    with limited_threads(terminal.threads):
        given = read_bundle(invocation.folder, bundle, *ADJUSTED_FROM, "solutions")
        written = write_normals(given, output, invocation.folder, force=force)
    if terminal.json:
        found = {"command": "results normals", "run": written.run, "file": str(output), "figures": written.unknowns}
        terminal.document("covariance", found)
    terminal.say(f"wrote    {output}: normal equations of {written.unknowns} unknowns")


def _write_covariance(
    invocation: Invocation, names: Sequence[str], output: Path | None, bundle: str | None, *, force: bool
) -> None:
    from orip.workflow.adjust.results import covariance_matrix, require_format, write_covariance
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


PageOutput = Annotated[
    Path | None, typer.Option("--output", "-o", metavar="FILE", help="Output file; default: report.html.")
]


Pdf = Annotated[
    bool, typer.Option("--pdf", help="Also print it to PDF, by Chromium, Chrome or Edge; --output names the PDF.")
]
Client = Annotated[
    bool,
    typer.Option("--client", help="Write the client's report instead, two to four pages: client_report.html."),
]
Certificate = Annotated[
    bool,
    typer.Option(
        "--certificate", help="Write the certificate of calibrated cameras instead: calibration_certificate.html."
    ),
]
Report = Annotated[bool, typer.Option("--report/--no-report", help="Also write the report, one HTML page.")]

Pictures = Annotated[
    bool,
    typer.Option("--pictures/--no-pictures", help="Show in the report the photos whose images are there."),
]


def tell_report(terminal: Terminal, written: WrittenReport) -> None:
    """Say where the report is."""
    terminal.result("wrote", f"{written.shown} ({written.size / 1e6:.1f} MB); open it in a browser")


def _register_report(app: typer.Typer) -> None:
    """Add the command."""

    @command(app, "report")
    def report_command(
        invocation: Invocation,
        bundle: BundleArgument = None,
        output: PageOutput = None,
        pdf: Pdf = False,
        client: Client = False,
        certificate: Certificate = False,
        force: ForceOption = False,
        pictures: Pictures = True,
    ) -> None:
        """Write the report of the last adjustment: one HTML page that needs no network.

        Example: orip report --output outcrop.html
        """
        kind = _kind(client=client, certificate=certificate)
        _refuse_the_other_kind(output, pdf=pdf)
        from orip.workflow.adjust.report import REPORTED_FROM, print_pdf, report
        from orip.workflow.project.bundle_state import read_bundle
        from orip.workflow.project.commit import commit
        from orip.workflow.project.outputs import require_replaceable

        given = read_bundle(invocation.folder, bundle, *REPORTED_FROM, "solutions")
        output = invocation.folder / output if output is not None else None
        page = output.with_suffix(".html") if output is not None and pdf else output
        if output is not None and pdf:
            require_replaceable(given.project, output, force=force)
        written = commit(report(given, page, force=force, kind=kind, pictures=pictures)).outcome
        terminal = invocation.terminal
        document = {"command": "report", "run": written.run, "bundle": written.bundle, "file": written.shown}
        tell_report(terminal, written)
        if pdf:
            printed = written.path.with_suffix(".pdf") if output is None else output
            document["pdf"] = given.project.shown(printed)
            size = print_pdf(written.path, printed, document["pdf"])
            terminal.say(f"wrote    {document['pdf']} ({size / 1e6:.1f} MB)")
        if terminal.json:
            terminal.document("report", document)


def _kind(*, client: bool, certificate: bool) -> ReportKind:
    """Return which report is wanted.

    Raises
    ------
    UsageError
        If it is two.
    """
    if client and certificate:
        message = "--client and --certificate are two files; write one after the other"
        raise UsageError(message)
    return "client" if client else "certificate" if certificate else "full"


def _refuse_the_other_kind(output: Path | None, *, pdf: bool) -> None:
    """Refuse a page that would be called .pdf, and a PDF that would replace its page.

    Raises
    ------
    UsageError
    """
    ending = "" if output is None else output.suffix.lower()
    if ending == ".pdf" and not pdf:
        message = f"the report is a page; print it with 'orip report --pdf --output {output}', or call it .html"
        raise UsageError(message)
    if ending in {".html", ".htm"} and pdf:
        message = "with --pdf the file of --output is the PDF, and the page is beside it; call it .pdf"
        raise UsageError(message)
