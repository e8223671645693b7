"""Workflow functions called with nobody watching."""

from __future__ import annotations

from pathlib import Path

from threadpoolctl import threadpool_limits

from orip.bundle.methods import Method
from orip.solving.solve import NOBODY, PLAIN
from orip.workflow.adjust.solve import ADJUSTED_FROM, SolveOutcome, solve
from orip.workflow.project.bundle_state import read_bundle
from orip.workflow.project.commit import commit
from orip.workflow.project.state import read_project
from orip.workflow.records.initialise import INITIALISED_FROM
from orip.workflow.records.reconcile import Prefer
from orip.workflow.run import RunWatcher, run


def hear_nothing(_told: object) -> None:
    """Be told of something and ignore it."""


def run_quietly(folder: Path, prefer: Prefer | None = None) -> tuple[SolveOutcome, ...]:
    """Do what `orip run` does."""
    with threadpool_limits(1):  # as the command line does: with more threads the last digits vary
        watcher = RunWatcher(hear_nothing, hear_nothing, NOBODY, hear_nothing, hear_nothing, lambda *_: None)
        return run(read_project(folder, *INITIALISED_FROM), prefer, watcher)


def solve_quietly(folder: Path, bundle: str | None = None, method: Method = PLAIN) -> SolveOutcome:
    """Do what `orip solve` does."""
    with threadpool_limits(1):
        return commit(solve(read_bundle(folder, bundle, *ADJUSTED_FROM), NOBODY, method)).outcome
