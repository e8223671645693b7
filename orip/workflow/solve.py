"""`orip solve`: the bundle adjustment of one bundle, from the stores to the stores."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from pathlib import Path

from orip.bundle.assemble import Ingredients, gather, with_starting_values
from orip.bundle.diagnosis import forewarnings
from orip.bundle.methods import Method, adjust_block
from orip.bundle.results import iteration_pass
from orip.errors import InputError, ProjectWarning
from orip.files.parsed import Parsed
from orip.files.stores import solutions
from orip.files.stores.digest import record_digest
from orip.files.stores.transaction import reading, writing
from orip.interior.measured import Measured
from orip.model.block import Block
from orip.model.measurement import PhotoObservations
from orip.model.names import record_key
from orip.model.solution import InteriorSummary, IterationPass, Solution
from orip.workflow.interior import Interior, interior_orientation
from orip.workflow.outputs import rewrite_stale_outputs, write_solution_outputs
from orip.workflow.project import Project, open_project
from orip.workflow.records import StoredDefinitions, read_definitions, require_initialised
from orip.workflow.run_id import digest_of_observations, digest_of_records, run_id
from orip.workflow.stored_measurements import read_measured
from orip.workflow.texts import Digests, GroundTexts, raise_complaints, read_ground

PLAIN = Method()
"""All observations, weights by the Danish method as the bundle's definition says."""


@dataclass(frozen=True, slots=True)
class SolveWatcher:
    """Who is told of an adjustment, and who may stop it.

    Parameters
    ----------
    started : callable
        Told the block before the first iteration.
    passed : callable
        Told each pass.
    stoppable : context manager
        Is entered for the time of the iterations and gives a function: once that returns True, the iteration in hand
        is the last one; the result is kept and marked as stopped.
    """

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


@dataclass(frozen=True, slots=True)
class _Stored:
    """What an adjustment takes from the stores."""

    definitions: StoredDefinitions
    observations: PhotoObservations
    interior: Interior
    digests: Digests


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
    stored = _read_stored(project, bundle)
    solution = _adjusted(project, stored, bundle, ground, watcher, method)
    with writing([project.exterior]) as stores:
        old = solutions.read(stores[project.exterior], bundle)
        changed = old is None or record_digest(old) != record_digest(solution)
        if changed:
            solutions.write(stores[project.exterior], solution)
    files = write_solution_outputs(project, solution)
    rewrite_stale_outputs(project)
    return SolveOutcome(project, solution, changed, files)


def _read_stored(project: Project, bundle: str) -> _Stored:
    with reading([*project.record_stores, project.observations(bundle)]) as stores:
        definitions = read_definitions(project, stores)
        require_initialised(project, definitions)
        measured = read_measured(project, stores, [bundle])
    observations = measured.observations.get(record_key(bundle))
    if observations is None:
        message = f"bundle {bundle} has no photo observations yet; run 'orip measure' first"
        raise InputError.single(message)
    digests = stored_digests(project, bundle, definitions, measured, observations)
    return _Stored(definitions, observations, interior_orientation(definitions.by_name(), measured), digests)


def _adjusted(
    project: Project,
    stored: _Stored,
    bundle: str,
    ground: Parsed[GroundTexts],
    watcher: SolveWatcher,
    method: Method,
) -> Solution:
    definitions, interior, texts = stored.definitions.by_name(), stored.interior, ground.records
    ingredients = Ingredients(
        stored.definitions.bundle(bundle), definitions.cameras, definitions.photos, interior.to_photo,
        interior.pixel_sizes, stored.observations, texts.control, texts.preliminary,
        project.definition.ground_unit, project.definition.crs,
    )  # fmt: skip
    gathered = gather(ingredients)
    if gathered.block is None:
        raise InputError((*interior.complaints, *gathered.complaints))
    block, start_warnings = with_starting_values(gathered.block, texts.preliminary)
    watcher.started(block)
    for_bundle = tuple(forewarnings(block))
    unit = project.definition.ground_unit
    with watcher.stoppable() as stop_asked:
        solution = adjust_block(block, method, unit, lambda record: watcher.passed(iteration_pass(record)), stop_asked)
    inputs = (*texts.digests, *stored.digests, project.heading_digest)
    solution = replace(
        solution,
        project=project.definition.name,
        user=project.definition.user,
        ground_unit=unit,
        inputs=inputs,
        interior=_summaries(interior, stored.definitions, stored.observations),
        warnings=_rows((*ground.warnings, *interior.warnings, *gathered.warnings, *start_warnings, *for_bundle)),
    )
    return replace(solution, run=run_id("solve", method, solution.status, len(solution.iterations), inputs))


def stored_digests(
    project: Project, bundle: str, definitions: StoredDefinitions, measured: Measured, observations: PhotoObservations
) -> Digests:
    """Return the digests of what a solution depends on in the stores, and of the project's crs if it has one."""
    cameras = [each.record for each in definitions.cameras]
    photos = [each.record for each in definitions.photos]
    return (
        (project.shown(project.cameras), digest_of_records(cameras)),
        (project.shown(project.photos), digest_of_records([*photos, *measured.photos.values()])),
        (project.shown(project.exterior), digest_of_records([definitions.bundle(bundle)])),
        (project.shown(project.observations(bundle)), digest_of_observations(observations)),
        *project.crs_digest,
    )


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
