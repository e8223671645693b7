"""`orip run`: the whole project in one command."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from orip.model.block import Block
from orip.model.solution import IterationPass
from orip.workflow.initialise import Initialised, initialise
from orip.workflow.measure import MeasureOutcome, measure
from orip.workflow.project import open_project
from orip.workflow.reconcile import Prefer
from orip.workflow.solve import SolveOutcome, solve


@dataclass(frozen=True, slots=True)
class Watcher:
    """Who is told of each step as it is done."""

    initialised: Callable[[Initialised], None]
    measured: Callable[[MeasureOutcome], None]
    started: Callable[[Block], None]
    passed: Callable[[IterationPass], None]
    solved: Callable[[SolveOutcome], None]


def run(
    folder: Path, prefer: Prefer | None, watcher: Watcher, stop_asked: Callable[[], bool]
) -> tuple[SolveOutcome, ...]:
    """Initialise, measure and solve all bundles.

    Every text file is read and checked before any store is touched.

    Raises
    ------
    InputError, NotSolvableError, LockedError
    """
    project = open_project(folder)
    watcher.initialised(initialise(folder, prefer))
    watcher.measured(measure(folder))
    outcomes = []
    for bundle in project.definition.bundles:
        outcomes.append(solve(folder, bundle.name, watcher.started, watcher.passed, stop_asked))
        watcher.solved(outcomes[-1])
        if outcomes[-1].solution.status == "stopped":
            break
    return tuple(outcomes)
