"""Whether the measurement log has to be replayed; without what replays it, which takes its time to import."""

from __future__ import annotations

from collections.abc import Sequence

from orip.files.stores.contents.definitions import StoredRecord
from orip.records.project.camera import Camera
from orip.records.project.photo import Temtick
from orip.structs import replace
from orip.wording import counted
from orip.workflow.project.definitions import StoredDefinitions
from orip.workflow.project.folder import ProjectFolder
from orip.workflow.project.outputs import is_interior_listing_stale
from orip.workflow.project.run_id import WRITTEN_BY, Step, changed_inputs, digest_of_records
from orip.workflow.project.state import ProjectState
from orip.workflow.project.texts import Digests, log_digests


def measure_step(state: ProjectState) -> Step:
    """Return whether the log has to be replayed.

    Parameters
    ----------
    state : ProjectState
        With `MEASURED_FROM` of `orip.workflow.observations.measure`.
    """
    project, command = state.project, "orip measure"
    log = log_digests(project, state.texts.measurement_files.value)
    files = counted(len(log), "measurement file")
    runs = set(state.replay.runs)
    if runs == {None}:
        what = f"{files} to replay" if log else "there are no measurement files (*.MEA) yet"
        return Step(command, "missing", what)
    if len(runs) > 1:
        return Step(command, "out of date", "some of its stores are missing or come from elsewhere")
    if changed := changed_inputs(state.replay.inputs, measurement_inputs(project, log, state.definitions)):
        return Step(command, "out of date", f"changed since: {', '.join(changed)}")
    if is_interior_listing_stale(project, str(runs.pop())):
        shown = project.shown(project.interior_listing)
        return Step(command, "out of date", f"{shown} is missing or older than the last run; {WRITTEN_BY}")
    return Step(command, "up to date", f"{files} in the stores")


def measurement_inputs(project: ProjectFolder, log: Digests, definitions: StoredDefinitions) -> Digests:
    """Return the digests of what a replay depends on: the log, and the definitions it refers to."""
    kinds: list[Sequence[StoredRecord[Camera] | StoredRecord[Temtick]]] = [definitions.cameras, definitions.temticks]
    marked = (item.record for records in kinds for item in records)
    marks = digest_of_records(record.fiducials if isinstance(record, Camera) else record for record in marked)
    places = digest_of_records(
        [template.record for template in definitions.templates]
        + [replace(photo.record, orientation=(), constant=()) for photo in definitions.photos]
    )
    return (*log, ("fiducial and tick marks", marks), ("photos on templates", places), project.heading_digest)
