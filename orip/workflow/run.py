"""`orip run`: the whole project in one command."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

from msgspec import Struct

from orip.annexes import DRIVE_STEPS, STATION_STEPS, annex
from orip.bundle.methods import Method
from orip.errors import ProjectWarning
from orip.solving.solve import PLAIN, SolveWatcher
from orip.workflow.adjust.gates import project_gates
from orip.workflow.adjust.solve import ADJUSTED_FROM, SolveOutcome, solve
from orip.workflow.observations.measure import MEASURED_FROM, MeasureOutcome, measure
from orip.workflow.project.bundle_state import BundleState
from orip.workflow.project.commit import Committed, carry_out, commit
from orip.workflow.project.folder import ProjectFolder
from orip.workflow.project.state import ProjectState, read_project
from orip.workflow.records.initialise import Initialised, initialise
from orip.workflow.records.reconcile import Prefer


class RunSettings(Struct, frozen=True):
    """What is adjusted and how.

    Parameters
    ----------
    bundle : str or None
        The only bundle to adjust; None: all.
    gates : tuple of str
        Gates besides those of orip.toml, for each bundle.
    """

    bundle: str | None = None
    method: Method = PLAIN
    gates: tuple[str, ...] = ()

    def bundles(self, project: ProjectFolder) -> tuple[str, ...]:
        """Return the names of the bundles to adjust.

        Raises
        ------
        UsageError
            If there is no such bundle.
        """
        return project.bundle_names if self.bundle is None else (project.bundle_name(self.bundle),)


EVERYTHING = RunSettings()


class RunWatcher(Struct, frozen=True):
    """Functions that are called after each step.

    `driven` is called with the drive table of a bundle with models, or why there is none; `processed` with the label of
    what was computed from receivers' files, and what is said of it.
    """

    initialised: Callable[[Initialised], None]
    measured: Callable[[Committed[MeasureOutcome]], None]
    solving: SolveWatcher
    solved: Callable[[Committed[SolveOutcome]], None]
    driven: Callable[[Any], None]
    processed: Callable[[str, str, tuple[ProjectWarning, ...]], None]


def run(
    state: ProjectState, prefer: Prefer | None, watcher: RunWatcher, settings: RunSettings = EVERYTHING
) -> tuple[SolveOutcome, ...]:
    """Initialise, measure and solve the bundles, check the gates of each solution, and write drive tables.

    Every step is committed before the next one begins, which reads what it has left in the stores. Every text file is
    read once, and checked before any store is touched.

    Parameters
    ----------
    state : ProjectState
        With `orip.workflow.records.initialise.INITIALISED_FROM`.

    Raises
    ------
    InputError, NotSolvableError, UsageError, LockedError
    """
    bundles = settings.bundles(state.project)
    project_gates(state.project, settings.gates)  # malformed ones are refused before anything is written
    state = _with_stations(state, watcher)
    watcher.initialised(carry_out(state, partial(initialise, prefer=prefer)).outcome)
    watcher.measured(commit(measure(state.read_again(*MEASURED_FROM))))
    outcomes: list[SolveOutcome] = []
    for name in bundles:
        bundle = BundleState(state.read_again(*ADJUSTED_FROM, bundles=[name]), name)
        solved = commit(solve(bundle, watcher.solving, settings.method, settings.gates))
        outcomes.append(solved.outcome)
        watcher.solved(solved)
        status = solved.outcome.solution.status
        if status in {"converged", "doubtful"} and bundle.definition.models:
            watcher.driven(annex(DRIVE_STEPS).table_of_run(state, name))  # few bundles have models
        if status == "stopped":
            break
    return tuple(outcomes)


def _with_stations(state: ProjectState, watcher: RunWatcher) -> ProjectState:
    """Return the state with exposure stations computed from the files of receivers and inertial units."""
    if not state.project.definition.has_receivers:
        return state
    is_changed = False
    for label, text, warnings in annex(STATION_STEPS).process_stations(state):
        watcher.processed(label, text, warnings)
        is_changed = True
    return read_project(state.project.folder, *state.parts) if is_changed else state
