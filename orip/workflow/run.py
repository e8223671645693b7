"""`orip run`: the whole project in one command."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from orip.files.parsed import Parsed
from orip.workflow.initialise import Initialised, initialise_project
from orip.workflow.measure import MeasureOutcome, measure_project
from orip.workflow.reconcile import Prefer
from orip.workflow.solve import SolveOutcome, SolveWatcher, solve_bundle
from orip.workflow.texts import open_project_with_texts


@dataclass(frozen=True, slots=True)
class RunWatcher:
    """Who is told of each step as it is done."""

    initialised: Callable[[Initialised], None]
    measured: Callable[[MeasureOutcome], None]
    solving: SolveWatcher
    solved: Callable[[SolveOutcome], None]


def run(folder: Path, prefer: Prefer | None, watcher: RunWatcher) -> tuple[SolveOutcome, ...]:
    """Initialise, measure and solve all bundles.

    Every text file is read once, and checked before any store is touched.

    Raises
    ------
    InputError, NotSolvableError, LockedError
    """
    project, texts = open_project_with_texts(folder)
    watcher.initialised(initialise_project(project, texts, prefer))
    watcher.measured(measure_project(project, Parsed(texts.records.log), on_top=False))
    outcomes: list[SolveOutcome] = []
    for bundle, ground in texts.records.ground.items():
        outcomes.append(solve_bundle(project, bundle, ground, watcher.solving))
        watcher.solved(outcomes[-1])
        if outcomes[-1].solution.status == "stopped":
            break
    return tuple(outcomes)
