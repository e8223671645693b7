"""Workflow functions called with nobody watching."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from threadpoolctl import threadpool_limits

from orip.bundle.methods import Method
from orip.workflow.adjust.solve import PLAIN, SolveOutcome, SolveWatcher, solve
from orip.workflow.records.reconcile import Prefer
from orip.workflow.run import RunWatcher, run


@contextmanager
def never_stopped() -> Iterator[Callable[[], bool]]:
    yield lambda: False


def hear_nothing(_told: object) -> None:
    """Be told of something and ignore it."""


NOBODY = SolveWatcher(oriented=hear_nothing, started=hear_nothing, passed=hear_nothing, stoppable=never_stopped)


def run_quietly(folder: Path, prefer: Prefer | None = None) -> tuple[SolveOutcome, ...]:
    """Do what `orip run` does."""
    with threadpool_limits(1):  # as the command line does: with more threads the last digits vary
        watcher = RunWatcher(hear_nothing, hear_nothing, NOBODY, hear_nothing, hear_nothing, hear_nothing)
        checked = run(folder, prefer, watcher)
    return tuple(each.outcome for each in checked)


def solve_quietly(folder: Path, bundle: str | None = None, method: Method = PLAIN) -> SolveOutcome:
    """Do what `orip solve` does."""
    with threadpool_limits(1):
        return solve(folder, bundle, NOBODY, method)
