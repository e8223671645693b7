"""`orip measure`: the measurement log into template and photo orientations and photo observations."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from orip.errors import LockedError, ProjectWarning
from orip.files.stores.definitions import StoredRecord
from orip.files.stores.provenance import read_inputs, write_inputs
from orip.files.stores.transaction import Stores, reading, writing
from orip.files.text.parsed import Parsed
from orip.interior.in_force import Interior, interior_orientation
from orip.interior.replay import Replayed, replay
from orip.mistakes.before_adjustment.checks import measurement_warnings
from orip.progress import stage
from orip.records.camera import Camera
from orip.records.measurement import Measured
from orip.records.names import record_key
from orip.records.photo import Temtick
from orip.workflow.project.definitions import (
    StoredDefinitions,
    read_definitions,
    require_initialised,
    write_definitions,
)
from orip.workflow.project.folder import Project, open_project
from orip.workflow.project.measurements import measured_stores, read_measured, runs_of_measurements, write_measured
from orip.workflow.project.outputs import rewrite_stale_outputs, write_interior_listing
from orip.workflow.project.run_id import digest_of_records, run_id
from orip.workflow.project.texts import Digests, MeasurementLog, measurement_files, raise_complaints, read_log


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


@dataclass(frozen=True, slots=True)
class _Before:
    """What the stores held when a replay began."""

    definitions: StoredDefinitions
    measured: Measured
    inputs: Digests
    runs: tuple[str | None, ...]


def measure(folder: Path, files: Sequence[Path] = ()) -> MeasureOutcome:
    """Replay measurement files into the stores and write INTERIOR_RESULT.OUT.

    Parameters
    ----------
    folder : Path
    files : sequence of Path
        Empty: the project's list, replayed from the beginning. Else these, on top of what the stores hold; relative
        ones are relative to the project folder.

    Raises
    ------
    InputError
        With everything that is wrong; nothing is written then.
    LockedError
    """
    project = open_project(folder)
    log = read_log(project, [project.folder / path for path in files])
    return measure_project(project, log, on_top=bool(files))


@stage("replaying measurements")
def measure_project(
    project: Project,
    log: Parsed[MeasurementLog],
    *,
    on_top: bool,
    write_log: Callable[[], None] = lambda: None,
) -> MeasureOutcome:
    """Do what `measure` does with a log that has been read.

    `write_log` writes what the log has and no file has yet. It is called when nothing can be refused any more, with the
    stores locked and before they change: killed in between, the text is ahead of the stores, and the next replay gives
    what this one would have.
    """
    raise_complaints(log.complaints)
    before = _read_before(project, with_observations=on_top)
    require_initialised(project, before.definitions)
    outcome = replay(log.records.records, before.definitions.by_name(), before.measured if on_top else Measured())
    raise_complaints(outcome.complaints)
    digitised = _with_digitised(before.definitions, outcome.measured)
    by_name = digitised.by_name()
    interior = interior_orientation(by_name, outcome.measured)
    raise_complaints(interior.complaints)
    found = measurement_warnings(by_name, outcome.measured, interior)
    run, inputs = _provenance(project, before, log.records, digitised, on_top=on_top)
    changed = any(each != run for each in before.runs)
    if changed:
        with writing({*project.record_stores, *measured_stores(project)}) as stores:
            _require_unchanged(project, stores, before)
            write_log()
            write_definitions(project, stores, before.definitions, digitised)
            write_measured(project, stores, outcome.measured, run)
            write_inputs(stores[project.photos], "measure", inputs)
    write_interior_listing(project, interior, run)
    rewrite_stale_outputs(project)
    outside = _outside_project(project, log.records.files) if on_top else []
    warnings = (*log.warnings, *outside, *outcome.warnings, *found)
    return MeasureOutcome(project, log.records.files, changed, _counts(project, outcome), interior, warnings)


def measurement_inputs(project: Project, log: Digests, definitions: StoredDefinitions) -> Digests:
    """Return the digests of what a replay depends on: the log, and the definitions it refers to."""
    records: list[Sequence[StoredRecord[Camera] | StoredRecord[Temtick]]] = [definitions.cameras, definitions.temticks]
    marks = digest_of_records(
        item.record.fiducials if isinstance(item.record, Camera) else item.record for each in records for item in each
    )
    places = digest_of_records(
        [each.record for each in definitions.templates]
        + [replace(each.record, orientation=(), constant=()) for each in definitions.photos]
    )
    return (*log, ("fiducial and tick marks", marks), ("photos on templates", places), project.heading_digest)


def _read_before(project: Project, *, with_observations: bool) -> _Before:
    bundles = [each.name for each in project.definition.bundles] if with_observations else []
    with reading({*project.record_stores, *measured_stores(project)}) as stores:
        return _Before(
            read_definitions(project, stores),
            read_measured(project, stores, bundles),
            read_inputs(stores[project.photos], "measure"),
            runs_of_measurements(project, stores),
        )


def _require_unchanged(project: Project, stores: Stores, before: _Before) -> None:
    """Raise LockedError if another run has changed the stores while this one was replaying."""
    if read_definitions(project, stores) != before.definitions or runs_of_measurements(project, stores) != before.runs:
        message = "another run of orip has changed the record stores meanwhile; nothing was written, repeat the command"
        raise LockedError(message)


def _provenance(
    project: Project, before: _Before, log: MeasurementLog, definitions: StoredDefinitions, *, on_top: bool
) -> tuple[str, Digests]:
    """Return the run id and the inputs to remember; a log on top of the stores adds to what they came from."""
    inputs = measurement_inputs(project, log.digests, definitions)
    if not on_top:
        return run_id("measure", inputs), inputs
    known = dict(inputs)
    kept = tuple(item for item in before.inputs if item[0] not in known)
    return run_id("measure", before.runs, inputs), (*kept, *inputs)


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


def _outside_project(project: Project, files: Sequence[Path]) -> list[ProjectWarning]:
    known = {path.resolve() for path in measurement_files(project).records}
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
