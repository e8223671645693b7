"""`orip solve`: the bundle adjustment of one bundle, from the stores to the stores."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from pathlib import Path

from orip.bundle.diagnosis import forewarnings
from orip.bundle.methods import Method, adjust_block
from orip.bundle.results import iteration_pass
from orip.errors import NotSolvableError, ProjectWarning
from orip.files.stores import solutions
from orip.files.stores.digest import same_record
from orip.files.stores.store import Store
from orip.files.stores.transaction import writing
from orip.files.text.parsed import Parsed
from orip.interior.in_force import Interior
from orip.mistakes.explanation import Trials, explanations_of, explanations_of_failure
from orip.prelim.project_coordinates import absolute_in_project
from orip.progress import stage
from orip.records.block import Block
from orip.records.measurement import PhotoObservations
from orip.records.names import record_key
from orip.records.preliminary import PreliminaryValues
from orip.records.solution import InteriorSummary, IterationPass, Solution
from orip.workflow.adjust.bundle_input import Stored, gathered_block, read_stored
from orip.workflow.adjust.starting_values import started_block
from orip.workflow.project.definitions import StoredDefinitions
from orip.workflow.project.folder import Project, open_project
from orip.workflow.project.outputs import rewrite_stale_outputs, write_solution_outputs
from orip.workflow.project.preliminary_outputs import ListedValues, listed_values, write_preliminary_listing
from orip.workflow.project.run_id import run_id
from orip.workflow.project.texts import GroundTexts, raise_complaints, read_ground

PLAIN = Method()
"""All observations, weights by the Danish method as the bundle's definition says."""


@dataclass(frozen=True, slots=True)
class SolveWatcher:
    """Who is told of an adjustment, and who may stop it.

    Parameters
    ----------
    oriented : callable
        Told the preliminary values, if some were missing and had to be found.
    started : callable
        Told the block before the first iteration.
    passed : callable
        Told each pass.
    stoppable : context manager
        Is entered for the time of the iterations and gives a function: once that returns True, the iteration in hand
        is the last one; the result is kept and marked as stopped.
    """

    oriented: Callable[[PreliminaryValues], None]
    started: Callable[[Block], None]
    passed: Callable[[IterationPass], None]
    stoppable: Callable[[], AbstractContextManager[Callable[[], bool]]]


@dataclass(frozen=True, slots=True)
class SolveOutcome:
    """What `orip solve` found, whether that is new to the store, and the files it wrote."""

    project: Project
    solution: Solution
    changed: bool
    files: tuple[Path, ...]


def solve(folder: Path, bundle: str | None, watcher: SolveWatcher, method: Method = PLAIN) -> SolveOutcome:
    """Adjust one bundle and keep its solution in the store and the outputs.

    Parameters
    ----------
    folder : Path
    bundle : str or None
        None: the project's only one.
    watcher : SolveWatcher
    method : Method
        Whether blunders are searched and needless camera parameters taken out.

    Raises
    ------
    InputError, NotSolvableError, LockedError, UsageError
    """
    project = open_project(folder)
    name = project.bundle_name(bundle)
    return solve_bundle(project, name, read_ground(project, name), watcher, method)


def solve_bundle(
    project: Project, bundle: str, ground: Parsed[GroundTexts], watcher: SolveWatcher, method: Method = PLAIN
) -> SolveOutcome:
    """Do what `solve` does with texts that have been read."""
    raise_complaints(ground.complaints)
    # No store is locked while the iterations run; the digests tell if one has changed meanwhile.
    stored = read_stored(project, bundle)
    solution, preliminary = _adjusted(project, stored, ground, watcher, method)
    with stage("keeping the solution"), writing([project.exterior]) as stores:
        changed = not _is_stored(stores[project.exterior], solution)
        if changed:
            solutions.write(stores[project.exterior], solution)
    listed = () if preliminary is None else (write_preliminary_listing(project, bundle, preliminary),)
    files = (*write_solution_outputs(project, solution, stored.observations), *listed)
    rewrite_stale_outputs(project)
    return SolveOutcome(project, solution, changed, files)


def _adjusted(
    project: Project,
    stored: Stored,
    ground: Parsed[GroundTexts],
    watcher: SolveWatcher,
    method: Method,
) -> tuple[Solution, ListedValues | None]:
    """Return the solution, and the preliminary values if they had to be found."""
    texts, interior = ground.records, stored.interior
    gathered, gather_warnings = gathered_block(project, stored, texts)
    trials = Trials(
        gathered,
        lambda block: started_block(block, texts.preliminary, lambda _: None)[0],
        tuple(each.record for each in stored.definitions.cameras),
        interior.warnings,
    )
    preliminary = None
    not_oriented: list[str] = []

    def oriented(values: PreliminaryValues) -> None:
        nonlocal preliminary
        preliminary = listed_values(absolute_in_project(values, gathered.ground), gathered.ground)
        not_oriented.extend(photo.name for photo in values.photos if photo.rotation is None)
        watcher.oriented(values)

    unit = project.definition.ground_unit
    try:
        block, start_warnings = started_block(gathered, texts.preliminary, oriented)
        watcher.started(block)
        with watcher.stoppable() as stop_asked:
            solution = adjust_block(
                block, method, unit, lambda record: watcher.passed(iteration_pass(record)), stop_asked
            )
    except NotSolvableError as error:
        causes = explanations_of_failure(trials, not_oriented)
        raise NotSolvableError("\n".join([*map(str, causes), str(error)])) from None
    for_bundle = tuple(forewarnings(block))
    solution = replace(solution, ground_unit=unit)
    explained = () if solution.status == "stopped" else explanations_of(solution, block, trials)
    inputs = (*texts.digests, *stored.digests, project.heading_digest)
    solution = replace(
        solution,
        project=project.definition.name,
        user=project.definition.user,
        inputs=inputs,
        interior=_summaries(interior, stored.definitions, stored.observations),
        warnings=_rows(
            (*explained, *ground.warnings, *interior.warnings, *gather_warnings, *start_warnings, *for_bundle)
        ),
    )
    run = run_id("solve", method, solution.status, len(solution.iterations), inputs)
    return replace(solution, run=run), preliminary


def _is_stored(store: Store, solution: Solution) -> bool:
    head = solutions.read_head(store, solution.bundle)
    if head is None or head.run != solution.run:  # spares reading all of the old one
        return False
    return same_record(solutions.read(store, solution.bundle), solution)


def _summaries(
    interior: Interior, definitions: StoredDefinitions, observations: PhotoObservations
) -> tuple[InteriorSummary, ...]:
    """Return the interior orientations of the bundle's photos and of the templates they are on."""
    seen = {record_key(name) for name in observations.photos}
    on = {
        record_key(each.record.template)
        for each in definitions.photos
        if each.record.template is not None and record_key(each.record.name) in seen
    }
    wanted = {"photos": seen, "templates": on}
    return tuple(
        each.summary for each in interior.adjustments if record_key(each.summary.name) in wanted[each.summary.group]
    )


def _rows(warnings: tuple[ProjectWarning, ...]) -> tuple[tuple[str, str, str], ...]:
    return tuple((warning.code, warning.where, warning.text) for warning in warnings)
