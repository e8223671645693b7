"""`orip solve`: the bundle adjustment of one bundle, from the stores to the stores."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

from orip.bundle.assemble import Ingredients, assemble
from orip.bundle.diagnosis import diagnose
from orip.bundle.results import iteration_pass, solution_of
from orip.bundle.solve import solve_block
from orip.errors import InputError, ProjectWarning
from orip.files.stores import solutions
from orip.files.stores.transaction import writing
from orip.interior.replay import Measured
from orip.model.block import Block
from orip.model.measurement import PhotoObservations
from orip.model.names import record_key
from orip.model.solution import InteriorSummary, IterationPass, Solution
from orip.workflow.interior import Interior, interior_orientation
from orip.workflow.measure import read_measured
from orip.workflow.outputs import rewrite_stale_outputs, write_outputs
from orip.workflow.project import Project, open_project
from orip.workflow.records import StoredDefinitions, read_definitions, require_initialised
from orip.workflow.run_id import digest_of_observations, digest_of_records, run_id
from orip.workflow.texts import control_files, digests, parse_control, parse_preliminary, raise_complaints


@dataclass(frozen=True, slots=True)
class SolveOutcome:
    """What `orip solve` found, and the files it wrote."""

    project: Project
    solution: Solution
    files: tuple[Path, ...]


def solve(
    folder: Path,
    bundle: str | None,
    on_start: Callable[[Block], None],
    on_pass: Callable[[IterationPass], None],
    stop_asked: Callable[[], bool],
) -> SolveOutcome:
    """Adjust one bundle and keep its solution in the store and the outputs.

    Parameters
    ----------
    folder : Path
    bundle : str or None
        None: the project's only one.
    on_start, on_pass : callables
        Told the block before, and each pass after, an iteration.
    stop_asked : callable
        True ends the iterations after the one in hand; the result is kept and marked as stopped.

    Raises
    ------
    InputError, NotSolvableError, LockedError, UsageError
    """
    project = open_project(folder)
    name = project.bundle_name(bundle)
    control, preliminary = parse_control(project), parse_preliminary(project, name)
    raise_complaints([control, preliminary])
    with writing([*project.record_stores, project.observations(name)]) as stores:
        definitions = read_definitions(project, stores)
        require_initialised(definitions)
        measured = read_measured(project, stores, [name])
        observations = measured.observations.get(record_key(name))
        if observations is None:
            message = f"bundle {name} has no photo observations yet; run 'orip measure' first"
            raise InputError.single(message)
        interior = interior_orientation(definitions.by_name(), measured)
        ingredients = Ingredients(
            definitions.bundle(name), definitions.by_name().cameras, definitions.by_name().photos,
            interior.to_photo, interior.pixel_sizes, observations, control.records, preliminary.records,
        )  # fmt: skip
        assembled = assemble(ingredients)
        if assembled.block is None:
            raise InputError((*interior.complaints, *assembled.complaints))
        on_start(assembled.block)
        solved = solve_block(assembled.block, lambda record: on_pass(iteration_pass(record)), stop_asked)
        found = diagnose(solved)
        inputs = solve_inputs(project, name, definitions, measured, observations)
        solution = replace(
            solution_of(solved),
            project=project.definition.name,
            user=project.definition.user,
            ground_unit=project.definition.ground_unit,
            inputs=inputs,
            interior=_summaries(interior, definitions, observations),
            diagnosis=found,
            warnings=_rows((*control.warnings, *preliminary.warnings, *interior.warnings, *assembled.warnings)),
        )
        solution = replace(solution, run=run_id("solve", solution.status, len(solution.iterations), inputs))
        solutions.write(stores[project.exterior], solution)
    files = write_outputs(project, solution)
    rewrite_stale_outputs(project)
    return SolveOutcome(project, solution, files)


def solve_inputs(
    project: Project, bundle: str, definitions: StoredDefinitions, measured: Measured, observations: PhotoObservations
) -> tuple[tuple[str, str], ...]:
    """Return the digests of all that a solution depends on: control and preliminary text, and the stores' content."""
    texts = [*control_files(project), *(path for path in [project.preliminary(bundle)] if path.is_file())]
    cameras = [each.record for each in definitions.cameras]
    photos = [each.record for each in definitions.photos]
    return (
        *digests(project, texts),
        (project.shown(project.cameras), digest_of_records(cameras)),
        (project.shown(project.photos), digest_of_records([*photos, *measured.photos.values()])),
        (project.shown(project.exterior), digest_of_records([definitions.bundle(bundle)])),
        (project.shown(project.observations(bundle)), digest_of_observations(observations)),
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
