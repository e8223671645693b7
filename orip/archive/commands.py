"""`orip archive`: many projects, adjusted by the workers of Dask."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NamedTuple

import typer

from orip.cli.method import MethodOptions
from orip.cli.options import Invocation, add_group, command
from orip.errors import GateError, OripError, UsageError

if TYPE_CHECKING:
    from orip.archive.run import ArchiveRequest


RESULTS = Path("archive_results")
"""The folder of results where none is named."""

_Results = Annotated[Path, typer.Argument(metavar="RESULTS", help="The folder of results.", show_default=True)]
_Roots = Annotated[
    list[Path] | None, typer.Argument(metavar="ROOT", help="Folders below which projects are; default: this one.")
]


class ClusterOptions(NamedTuple):
    """Options of where the projects are adjusted."""

    dask: Annotated[
        str | None, typer.Option("--dask", metavar="ADDRESS", help="A scheduler of Dask, such as tcp://host:8786.")
    ] = None
    workers: Annotated[
        int | None,
        typer.Option(
            "--workers", min=1, help="Worker processes on this machine (default: its cores, and one for every 8 more)."
        ),
    ] = None


class LimitOptions(NamedTuple):
    """Options of what a project may use."""

    memory: Annotated[
        int, typer.Option("--memory", metavar="MB", min=1, help="Memory that one project may use.", show_default=True)
    ] = 4000
    time: Annotated[
        float, typer.Option("--time", metavar="SECONDS", min=0.01, help="Time that it may take.", show_default=True)
    ] = 3600.0


class RunOptions(NamedTuple):
    """Options of what is written."""

    out: Annotated[Path, typer.Option("--out", metavar="DIR", help="The folder of results.", show_default=True)] = (
        RESULTS
    )
    report: Annotated[bool, typer.Option("--report/--no-report", help="Write the report of each project.")] = True
    again: Annotated[bool, typer.Option("--again", help="Adjust finished projects, too.")] = False


def register(app: typer.Typer) -> None:
    """Add the group of commands."""
    text = "Many projects at once, on the cores of this machine or of many.\n\nExample: orip archive run surveys"
    add_group(app, "archive", text, _register)


def _register(group: typer.Typer) -> None:
    _register_run(group)
    _register_reading(group)
    _register_simulate(group)


def _register_run(group: typer.Typer) -> None:
    @command(group, "run")
    def run_command(
        invocation: Invocation,
        run: RunOptions,
        cluster: ClusterOptions,
        limits: LimitOptions,
        method: MethodOptions,
        roots: _Roots = None,
    ) -> None:
        """Adjust all projects below some folders that are not finished, each in a process with limits.

        What a project is made from decides whether it is finished, so that a run that was ended in any way is taken up
        by the same command. A project that cannot be adjusted is a result, with its error. Exit code 1 if the machine
        kept a project from being adjusted.

        Example: orip archive run surveys --out results
        """
        from orip.archive.output import run_document, tell_run, watcher
        from orip.archive.run import run_archive

        terminal = invocation.terminal
        request = _request(invocation.folder, roots or [Path()], run, cluster, limits, method)
        done = run_archive(request, watcher(terminal))
        if terminal.json:
            terminal.document("archive-run", run_document(done))
        tell_run(terminal, done)
        if done.progress.states["machine"]:
            raise typer.Exit(OripError.exit_code)


def _register_reading(group: typer.Typer) -> None:
    @command(group, "status", reads_only=True)
    def status_command(invocation: Invocation, results: _Results = RESULTS) -> None:
        """Tell how far a run is, also while it runs elsewhere.

        Example: orip archive status results
        """
        from orip.archive.output import show_status
        from orip.archive.status import archive_status

        show_status(invocation.terminal, archive_status(invocation.folder / results))

    @command(group, "report")
    def report_command(invocation: Invocation, results: _Results = RESULTS) -> None:
        """Write the tables and the overview page of what is finished, also while a run goes on.

        Example: orip archive report results
        """
        from orip.archive.cluster.connection import require_dask
        from orip.archive.output import report_document, tell_collected
        from orip.archive.results import collect
        from orip.archive.run_files import ResultsFolder, read_plan

        require_dask()

        folder = (invocation.folder / results).resolve()
        collected = collect(ResultsFolder(folder), read_plan(folder, str(results)))
        if invocation.terminal.json:
            invocation.terminal.document("archive-report", report_document(collected))
        tell_collected(invocation.terminal, collected)

    @command(group, "diff", reads_only=True)
    def diff_command(
        invocation: Invocation,
        before: Annotated[Path, typer.Argument(metavar="BEFORE", help="The folder of results of a run.")],
        after: Annotated[Path, typer.Argument(metavar="AFTER", help="That of the run to compare it with.")],
        sigma: Annotated[
            float, typer.Option("--sigma", min=0.0, help="Standard deviations that a value may move by.")
        ] = 1.0,
    ) -> None:
        """Compare two runs: what moved by more than its standard deviation, and which gates have changed.

        Exit code 0 if there is nothing of that kind, 5 if there is.

        Example: orip archive diff results_2025 results_2026
        """
        from orip.archive.diff import archive_differences
        from orip.archive.output import show_differences

        found = archive_differences(invocation.folder / before, invocation.folder / after, sigma)
        show_differences(invocation.terminal, found)
        if not found.is_equal:
            raise typer.Exit(GateError.exit_code)


def _register_simulate(group: typer.Typer) -> None:
    @command(group, "simulate")
    def simulate_command(
        invocation: Invocation,
        number: Annotated[int, typer.Argument(metavar="N", min=1, max=999_999, help="How many projects.")],
        folder: Annotated[Path, typer.Argument(metavar="FOLDER", help="A new or empty folder.")],
        seed: Annotated[int, typer.Option("--seed", min=0, help="Another seed, other projects.")] = 1,
        faults: Annotated[
            float, typer.Option("--faults", min=0.0, max=1.0, help="Part of the projects with a mistake.")
        ] = 0.05,
    ) -> None:
        """Write simulated projects of twelve photos, to try an archive on; some share cameras, some have a mistake.

        Example: orip archive simulate 20 surveys
        """
        from orip.archive.output import tell_simulated
        from orip.archive.simulation import simulate_archive

        tell_simulated(invocation.terminal, simulate_archive(invocation.folder / folder, number, seed, faults))


def _request(
    folder: Path,
    roots: list[Path],
    run: RunOptions,
    cluster: ClusterOptions,
    limits: LimitOptions,
    method: MethodOptions,
) -> ArchiveRequest:
    """Return what the options ask for.

    Raises
    ------
    UsageError
        If they contradict each other, or a gate is malformed.
    """
    from orip.archive.cluster.connection import require_dask
    from orip.archive.run import ArchiveRequest
    from orip.archive.task import Limits, TaskSettings
    from orip.workflow.adjust.gates import gates_from

    require_dask()

    if cluster.dask is not None and cluster.workers is not None:
        message = "--workers starts workers on this machine, and --dask uses those of a scheduler; give one of them"
        raise UsageError(message)
    gates = tuple(method.check or ())
    gates_from(gates)
    limit = Limits(limits.time, limits.memory)
    settings = TaskSettings(method.method(), gates, report=run.report, again=run.again, limits=limit)
    paths = tuple(folder / root for root in roots)
    return ArchiveRequest(paths, folder / run.out, settings, _words(method), cluster.dask, cluster.workers)


def _words(method: MethodOptions) -> str:
    """Return the method in words."""
    words = ["data snooping" if method.snoop else "reduced weights"]
    words += ["insignificant camera parameters held"] if method.prune else []
    words += ["variance components estimated"] if method.variance_components else []
    return ", ".join(words)
