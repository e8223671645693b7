"""`orip measure`: the measurement log into template and photo orientations and photo observations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from orip.errors import InputError, ProjectWarning
from orip.files.atomic_text import replace_text
from orip.files.interior_listing import interior_listing
from orip.files.parsed import Parsed
from orip.files.stores import observations, photos, templates
from orip.files.stores.definitions import StoredRecord
from orip.files.stores.provenance import read_inputs, run_of, set_run, write_inputs
from orip.files.stores.transaction import Stores, writing
from orip.interior.replay import Measured, Replayed, replay
from orip.model.camera import Camera
from orip.model.measurement import no_observations
from orip.model.names import record_key
from orip.model.photo import Temtick
from orip.workflow.interior import Interior, interior_orientation
from orip.workflow.outputs import rewrite_stale_outputs
from orip.workflow.project import Project, open_project
from orip.workflow.records import StoredDefinitions, read_definitions, require_initialised, write_definitions
from orip.workflow.run_id import digest_of_records, run_id
from orip.workflow.texts import (
    MeasurementLog,
    digests,
    measurement_files,
    parse_log,
    parse_project_log,
    raise_complaints,
)


@dataclass(frozen=True, slots=True)
class MeasurementCounts:
    """How much is measured: points of each bundle, oriented templates and photos, points measured again."""

    templates: int
    photos: int
    points: tuple[tuple[str, int], ...]
    remeasured: int


@dataclass(frozen=True, slots=True)
class MeasureOutcome:
    """What `orip measure` did."""

    project: Project
    files: tuple[Path, ...]
    changed: bool
    counts: MeasurementCounts
    interior: Interior
    warnings: tuple[ProjectWarning, ...]


def measure(folder: Path, files: Sequence[Path] = ()) -> MeasureOutcome:
    """Replay measurement files into the stores and write INTERIOR_RESULT.OUT.

    Parameters
    ----------
    folder : Path
    files : sequence of Path
        Empty: the project's list, replayed from the beginning. Else these, on top of what the stores hold.

    Raises
    ------
    InputError
        With everything that is wrong; nothing is written then.
    """
    project = open_project(folder)
    log = parse_log(project, files) if files else parse_project_log(project)
    raise_complaints([log])
    # the observation stores of all bundles are locked: a replay may touch any of them
    with writing({*project.record_stores, *_measured_stores(project)}) as stores:
        definitions = read_definitions(project, stores)
        require_initialised(definitions)
        bundles = [each.name for each in project.definition.bundles]
        start = read_measured(project, stores, bundles) if files else Measured()
        outcome = replay(log.records.records, definitions.by_name(), start)
        if outcome.complaints:
            raise InputError(outcome.complaints)
        digitised = _with_digitised(definitions, outcome.measured)
        interior = interior_orientation(digitised.by_name(), outcome.measured)
        if interior.complaints:
            raise InputError(interior.complaints)
        run, inputs = _provenance(project, stores, log.records, digitised, on_top=bool(files))
        changed = any(run_of(stores[path]) != run for path in _measured_stores(project))
        if changed:
            write_definitions(project, stores, definitions, digitised)
            _write_measured(project, stores, outcome.measured, run)
            write_inputs(stores[project.photos], "measure", inputs)
    listing = interior_listing(interior.adjustments, project.definition.name, project.definition.user, run)
    replace_text(project.interior_listing, listing)
    rewrite_stale_outputs(project)
    warnings = (*log.warnings, *_outside_project(project, files), *outcome.warnings, *interior.warnings)
    return MeasureOutcome(project, log.records.files, changed, _counts(project, outcome), interior, warnings)


def read_measured(project: Project, stores: Stores, bundles: Sequence[str]) -> Measured:
    """Return what the stores hold of measurements, photo observations of the named bundles alone."""
    found = {}
    for bundle in bundles:
        each = observations.read(stores[project.observations(bundle)])
        if each is not None:
            found[record_key(bundle)] = each
    return Measured(
        templates.read_orientations(stores[project.templates]), photos.read_orientations(stores[project.photos]), found
    )


def _measured_stores(project: Project) -> tuple[Path, ...]:
    bundles = (project.observations(each.name) for each in project.definition.bundles)
    return project.templates, project.photos, *bundles


def measurement_inputs(
    project: Project, files: Sequence[Path], definitions: StoredDefinitions
) -> tuple[tuple[str, str], ...]:
    """Return the digests of what a replay depends on: the log, and the definitions it refers to."""
    records: list[Sequence[StoredRecord[Camera] | StoredRecord[Temtick]]] = [definitions.cameras, definitions.temticks]
    marks = digest_of_records(
        item.record.fiducials if isinstance(item.record, Camera) else item.record for each in records for item in each
    )
    places = digest_of_records(
        [each.record for each in definitions.templates]
        + [replace(each.record, orientation=(), constant=()) for each in definitions.photos]
    )
    return (*digests(project, files), ("fiducial and tick marks", marks), ("photos on templates", places))


def _provenance(
    project: Project, stores: Stores, log: MeasurementLog, definitions: StoredDefinitions, *, on_top: bool
) -> tuple[str, tuple[tuple[str, str], ...]]:
    """Return the run id and the inputs to remember; a log on top of the stores adds to what they came from."""
    inputs = measurement_inputs(project, log.files, definitions)
    if not on_top:
        return run_id("measure", inputs), inputs
    earlier = read_inputs(stores[project.photos], "measure")
    known = dict(inputs)
    kept = tuple(item for item in earlier if item[0] not in known)
    return run_id("measure", run_of(stores[project.photos]), inputs), (*kept, *inputs)


def _with_digitised(definitions: StoredDefinitions, measured: Measured) -> StoredDefinitions:
    """Return the definitions with digitised fiducial and tick marks taken into their records."""
    return replace(
        definitions,
        cameras=tuple(
            replace(each, record=measured.cameras.get(record_key(each.record.name), each.record))
            for each in definitions.cameras
        ),
        temticks=tuple(
            replace(each, record=measured.temticks.get(record_key(each.record.name), each.record))
            for each in definitions.temticks
        ),
    )


def _write_measured(project: Project, stores: Stores, measured: Measured, run: str) -> None:
    templates.write_orientations(stores[project.templates], measured.templates.values())
    photos.write_orientations(stores[project.photos], measured.photos.values())
    for bundle in project.definition.bundles:
        found = measured.observations.get(record_key(bundle.name), no_observations(bundle.name))
        observations.write(stores[project.observations(bundle.name)], found)
    for path in _measured_stores(project):
        set_run(stores[path], run)


def _outside_project(project: Project, files: Sequence[Path]) -> list[ProjectWarning]:
    listed: Parsed[tuple[Path, ...]] = measurement_files(project)
    known = {path.resolve() for path in listed.records}
    text = "is not among the project's measurement_files: 'orip measure' and 'orip run' will not replay it"
    return [
        ProjectWarning("not-in-project", project.shown(path), text) for path in files if path.resolve() not in known
    ]


def _counts(project: Project, outcome: Replayed) -> MeasurementCounts:
    points = tuple(
        (bundle.name, len(found.points))
        for bundle in project.definition.bundles
        if (found := outcome.measured.observations.get(record_key(bundle.name))) is not None
    )
    measured = outcome.measured
    return MeasurementCounts(len(measured.templates), len(measured.photos), points, outcome.remeasured)
