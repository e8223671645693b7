"""`orip solve`, and the options that divide a block among the workers of Dask."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import typer

from orip.annexes import DIVIDED_BLOCK, annex
from orip.cli.method import AllPhotos, MethodOptions, exit_code, solve_watcher, tell_solution
from orip.cli.options import BundleArgument, Invocation, command
from orip.cli.results import Pictures, Report, tell_report
from orip.cli.terminal import Terminal
from orip.errors import UsageError
from orip.structs import replace
from orip.threads import limited_threads
from orip.wording import counted

if TYPE_CHECKING:
    from orip.bundle.problem import BlockProblem
    from orip.records.block import Block
    from orip.records.results.solution import IterationPass
    from orip.solving.solve import SolveWatcher


_LOCAL = "local"
_MEGABYTE = 1_000_000


class ClusterOptions(NamedTuple):
    """Where the normal equations are computed."""

    dask: Annotated[
        str | None,
        typer.Option(
            "--dask",
            metavar="ADDRESS|local",
            help="Divide the block among the workers of a scheduler of Dask (tcp://host:8786), or of this machine.",
        ),
    ] = None
    workers: Annotated[
        int | None, typer.Option("--workers", min=1, help="With --dask local: worker processes (default: the cores).")
    ] = None
    worker_memory: Annotated[
        int | None,
        typer.Option("--worker-memory", metavar="MB", min=1, help="With --dask local: memory of each worker."),
    ] = None

    @contextmanager
    def columns_set_aside(self, project: Path) -> Iterator[None]:
        """Keep what has a number for every photo point in files, where the block is divided."""
        if self.dask is None:
            yield
            return
        with annex(DIVIDED_BLOCK).columns_of_project(project):
            yield

    @contextmanager
    def posing(
        self, terminal: Terminal, project: Path
    ) -> Iterator[tuple[Callable[[Block], BlockProblem], SolveWatcher]]:
        """Yield how blocks are posed as problems, and what shows the progress of their adjustment.

        Raises
        ------
        UsageError
            If the options contradict each other, or Dask is not installed.
        OripError
            If there is no cluster that is fit.
        """
        from orip.bundle.problem import pose_problem

        watcher = solve_watcher(terminal)
        if self.dask is None:
            self._require_nothing_else()
            yield pose_problem, watcher
            return
        self._require_own_workers()
        divided = annex(DIVIDED_BLOCK)
        scheduler = None if self.dask == _LOCAL else self.dask
        with divided.divided_blocks(
            divided.ClusterRequest(scheduler, self.workers, _MEGABYTE * (self.worker_memory or 0)), project
        ) as blocks:
            moved: list[Any] = []

            def passed(row: IterationPass) -> None:
                watcher.passed(row)
                moved.append(blocks.moved())
                terminal.detail(f"         {_moved_text(moved[-1])}")

            yield blocks.pose, replace(watcher, passed=passed)
            if moved and blocks.trees:
                tree, most = blocks.trees[-1], max(moved, key=lambda one: one.total)
                terminal.say(
                    f"dask     {counted(len(tree), 'sub-block')}; in one iteration at most {_moved_text(most)}"
                )

    def _require_nothing_else(self) -> None:
        if self.workers is not None or self.worker_memory is not None:
            message = "--workers and --worker-memory need --dask local; add it, or leave them out"
            raise UsageError(message)

    def _require_own_workers(self) -> None:
        if self.dask != _LOCAL and (self.workers is not None or self.worker_memory is not None):
            message = (
                f"--workers and --worker-memory are for --dask local; the workers of {self.dask} were started with "
                "theirs, so leave them out"
            )
            raise UsageError(message)


def _moved_text(moved: Any) -> str:
    parts = (moved.there, moved.back, moved.between)
    there, back, between = (f"{part / _MEGABYTE:.1f}" for part in parts)
    return (
        f"{moved.total / _MEGABYTE:.1f} MB moved ({there} to workers, {back} from them, {between} between them; "
        f"the equations of the separators are {moved.separators / _MEGABYTE:.1f} MB)"
    )


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
        pictures: Pictures = True,
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
                state = state.read_again(*REPORTED_FROM)
                reported = report_of(state, outcome.solution, outcome.gates, pictures=pictures)
                tell_report(terminal, commit(reported).outcome)
            if terminal.json:
                terminal.data(result_text(outcome.solution))
        raise typer.Exit(exit_code(outcome, all_wanted=all_photos))
