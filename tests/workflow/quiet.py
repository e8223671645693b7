"""Workflow functions called with nobody watching."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from orip.workflow.reconcile import Prefer
from orip.workflow.run import RunWatcher, run
from orip.workflow.solve import SolveOutcome, SolveWatcher, solve


@contextmanager
def never_stopped() -> Iterator[Callable[[], bool]]:
    yield lambda: False


NOBODY = SolveWatcher(started=lambda block: None, passed=lambda each: None, stoppable=never_stopped)


def run_quietly(folder: Path, prefer: Prefer | None = None) -> tuple[SolveOutcome, ...]:
    """Do what `orip run` does."""
    return run(folder, prefer, RunWatcher(lambda done: None, lambda done: None, NOBODY, lambda done: None))


def solve_quietly(folder: Path, bundle: str | None = None) -> SolveOutcome:
    """Do what `orip solve` does."""
    return solve(folder, bundle, NOBODY)
