"""`orip measure`: the measurement log into template and photo orientations and photo observations."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from msgspec import Struct

from orip.errors import ProjectWarning
from orip.files.text.regular_file import file_of
from orip.files.text.shown import Parsed
from orip.interior.in_force import Interior
from orip.interior.replay import Replayed, replay
from orip.mistakes.checks import measurement_warnings, raise_if_impossible
from orip.progress import stage
from orip.records.measurement import Measured
from orip.records.names import record_key
from orip.structs import replace
from orip.workflow.project.commit import Change
from orip.workflow.project.definitions import StoredDefinitions, measured_stores
from orip.workflow.project.folder import ProjectFolder
from orip.workflow.project.outputs import interior_output
from orip.workflow.project.run_id import run_id
from orip.workflow.project.state import Part, ProjectState, ReplayRecord, StoredParts
from orip.workflow.project.texts import Digests, MeasurementLog, raise_complaints, read_log
from orip.workflow.status import measurement_inputs

MEASURED_FROM: tuple[Part, ...] = ("definitions", "replay")
"""What a replay of the whole log needs of the stores."""

MEASURED_ON_TOP: tuple[Part, ...] = (*MEASURED_FROM, "marks", "observations")
"""What a replay on top of the stores needs of them."""


class MeasurementCounts(Struct, frozen=True):
    """How much is measured: points of each bundle, oriented templates and photos, points measured again."""

    templates: int
    photos: int
    points: tuple[tuple[str, int], ...]
    remeasured: int


class MeasureOutcome(Struct, frozen=True):
    """What `orip measure` found."""

    project: ProjectFolder
    files: tuple[Path, ...]
    counts: MeasurementCounts
    interior: Interior
    warnings: tuple[ProjectWarning, ...]


def measure(state: ProjectState) -> Change[MeasureOutcome]:
    """Replay the measurement files of a project from the beginning.

    Parameters
    ----------
    state : ProjectState
        With `MEASURED_FROM`.

    Raises
    ------
    InputError
        With everything that is wrong.
    """
    return replay_log(state, state.texts.log)


def measure_on_top(state: ProjectState, files: Sequence[Path]) -> Change[MeasureOutcome]:
    """Replay other measurement files on top of what the stores hold.

    Parameters
    ----------
    state : ProjectState
        With `MEASURED_ON_TOP`.

    Raises
    ------
    InputError
        With everything that is wrong.
    """
    log = read_log(state.project, files)
    change = _replayed(state, log, state.measured, _provenance_on_top)
    warnings = (*log.warnings, *_outside_project(state, files), *change.outcome.warnings)
    return replace(change, outcome=replace(change.outcome, warnings=warnings))


def replay_log(state: ProjectState, log: Parsed[MeasurementLog]) -> Change[MeasureOutcome]:
    """Replay a log from the beginning, see `measure`."""
    change = _replayed(state, log, Measured(), _provenance)
    return replace(change, outcome=replace(change.outcome, warnings=(*log.warnings, *change.outcome.warnings)))


@stage("replaying measurements")
def _replayed(
    state: ProjectState, log: Parsed[MeasurementLog], before: Measured, provenance: Callable[..., _Provenance]
) -> Change[MeasureOutcome]:
    """Replay a log; a log that the stores hold already does not touch them."""
    raise_complaints(log.complaints)
    state.require_initialised()
    raise_if_impossible(state.records.cameras.values())
    project = state.project
    outcome = replay(log.value.records, state.records, before)
    raise_complaints(outcome.complaints)
    digitised = with_digitised(state.definitions, outcome.measured)
    after = state.with_stored(StoredParts(digitised, outcome.measured))
    interior = after.interior
    raise_complaints(interior.complaints)
    warnings = (*outcome.warnings, *measurement_warnings(after.records, outcome.measured, interior))
    run, inputs = provenance(state, measurement_inputs(project, log.value.digests, digitised))
    found = MeasureOutcome(project, log.value.files, _counts(project, outcome), interior, warnings)
    change = Change(state, found, outputs=(interior_output(project, interior, run),), restores_outputs=True)
    if all(stored == run for stored in state.replay.runs):
        return change
    replayed = ReplayRecord(inputs, (run,) * len(state.replay.runs))
    locks = tuple(dict.fromkeys((*project.record_stores, *measured_stores(project))))
    return replace(change, stored=StoredParts(digitised, outcome.measured, replayed), locks=locks)


_Provenance = tuple[str, Digests]
"""The run id, and the inputs to remember."""


def _provenance(_state: ProjectState, inputs: Digests) -> _Provenance:
    return run_id("measure", inputs), inputs


def _provenance_on_top(state: ProjectState, inputs: Digests) -> _Provenance:
    """Return the run id and the inputs of a log that adds to what the stores were replayed from."""
    known = dict(inputs)
    kept = tuple(item for item in state.replay.inputs if item[0] not in known)
    return run_id("measure", state.replay.runs, inputs), (*kept, *inputs)


def with_digitised(definitions: StoredDefinitions, measured: Measured) -> StoredDefinitions:
    """Return the definitions with digitised fiducial and tick marks taken into their records."""
    return replace(
        definitions,
        cameras=tuple(
            replace(camera, record=measured.cameras.get(record_key(camera.record.name), camera.record))
            for camera in definitions.cameras
        ),
        temticks=tuple(
            replace(temtick, record=measured.temticks.get(record_key(temtick.record.name), temtick.record))
            for temtick in definitions.temticks
        ),
    )


def _outside_project(state: ProjectState, files: Sequence[Path]) -> list[ProjectWarning]:
    known = {file_of(path) for path in state.texts.measurement_files.value}
    text = "is not among the project's measurement_files: 'orip measure' and 'orip run' will not replay it"
    return [
        ProjectWarning("not-in-project", state.project.shown(path), text)
        for path in files
        if file_of(path) not in known
    ]


def _counts(project: ProjectFolder, outcome: Replayed) -> MeasurementCounts:
    points = tuple(
        (bundle, len(found.points))
        for bundle in project.bundle_names
        if (found := outcome.measured.observations.get(record_key(bundle))) is not None
    )
    measured = outcome.measured
    return MeasurementCounts(len(measured.templates), len(measured.photos), points, outcome.remeasured)
