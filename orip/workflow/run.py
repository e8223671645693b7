"""`orip run`: the whole project in one command."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from orip.errors import InputError
from orip.files.text.parsed import Parsed
from orip.workflow.adjust.gates import check_solution, project_gates
from orip.workflow.adjust.solve import SolveWatcher, solve_bundle
from orip.workflow.adjust.solve_checked import CheckedSolve
from orip.workflow.drive.table import DriveTableOutcome, write_bundle_drive_table
from orip.workflow.observations.measure import MeasureOutcome, measure_project
from orip.workflow.project.folder import Project
from orip.workflow.project.texts import open_project_with_texts
from orip.workflow.records.initialise import Initialised, initialise_project
from orip.workflow.records.reconcile import Prefer


@dataclass(frozen=True, slots=True)
class RunWatcher:
    """Who is told of each step as it is done."""

    initialised: Callable[[Initialised], None]
    measured: Callable[[MeasureOutcome], None]
    solving: SolveWatcher
    solved: Callable[[CheckedSolve], None]
    tabled: Callable[[DriveTableOutcome], None]
    not_tabled: Callable[[InputError], None]


def run(folder: Path, prefer: Prefer | None, watcher: RunWatcher) -> tuple[CheckedSolve, ...]:
    """Initialise, measure and solve all bundles, hold the gates of orip.toml against each, and write drive tables.

    Every text file is read once, and checked before any store is touched.

    Raises
    ------
    InputError, NotSolvableError, LockedError
    """
    project, texts = open_project_with_texts(folder)
    gates = project_gates(project)
    watcher.initialised(initialise_project(project, texts, prefer))
    watcher.measured(measure_project(project, Parsed(texts.records.log), on_top=False))
    checked: list[CheckedSolve] = []
    for bundle, ground in texts.records.ground.items():
        outcome = solve_bundle(project, bundle, ground, watcher.solving)
        checked.append(CheckedSolve(outcome, check_solution(outcome.solution, gates)))
        watcher.solved(checked[-1])
        if outcome.solution.status in {"converged", "doubtful"} and _has_models(project, bundle):
            _write_table(project, bundle, watcher)
        if outcome.solution.status == "stopped":
            break
    return tuple(checked)


def _has_models(project: Project, bundle: str) -> bool:
    return any(each.models for each in project.definition.bundles if each.name == bundle)


def _write_table(project: Project, bundle: str, watcher: RunWatcher) -> None:
    """Write the drive table; an adjustment is worth no less for models that cannot be driven."""
    try:
        outcome = write_bundle_drive_table(project, bundle)
    except InputError as error:
        watcher.not_tabled(error)
    else:
        watcher.tabled(outcome)
