"""Whether each step of the work is up to date, without what does it, which takes its time to import."""

from __future__ import annotations

from collections.abc import Sequence

from orip.files.stores.contents.definitions import StoredRecord
from orip.files.stores.contents.solution_tables import SolutionHead
from orip.files.stores.digest import record_digest
from orip.records.camera import Camera
from orip.records.names import record_key
from orip.records.photo import Temtick
from orip.structs import replace
from orip.wording import counted
from orip.workflow.project.bundle_state import BundleState
from orip.workflow.project.definitions import StoredDefinitions
from orip.workflow.project.folder import ProjectFolder
from orip.workflow.project.outputs import is_interior_listing_stale, stale_solution_outputs
from orip.workflow.project.run_id import WRITTEN_BY, Step, changed_inputs, digest_of_records
from orip.workflow.project.state import ProjectState
from orip.workflow.project.texts import Digests, control_input_digests, log_digests
from orip.workflow.records.reconcile import apply_text, counted_changes


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
    sources = tuple((one.record.name, one.record.points_of) for one in definitions.bundles if one.record.points_of)
    shared = (("points_of of bundles", record_digest(sources)),) if sources else ()
    marks_and_places = ("fiducial and tick marks", marks), ("photos on templates", places)
    return (*log, *marks_and_places, *shared, project.heading_digest)


def initialise_step(state: ProjectState) -> Step:
    """Return whether orip.toml has to be applied to the stores."""
    applied, command = apply_text(state.project, state.definitions, prefer=None), "orip init"
    if applied.complaints:
        text = f"changed both in orip.toml and in the stores: {len(applied.complaints)} of the records"
        return Step(command, "out of date", text)
    if applied.changes and state.definitions.are_empty:
        return Step(command, "missing", "orip.toml has not been applied to the stores")
    if applied.changes:
        return Step(command, "out of date", f"to be applied to the stores: {counted_changes(applied.changes)}")
    return Step(command, "up to date", "the stores hold what orip.toml says")


def solve_step(bundle: BundleState) -> Step:
    """Return whether a bundle has to be adjusted.

    Parameters
    ----------
    bundle : BundleState
        With `ADJUSTED_FROM` and the head of the solution.
    """
    project, command = bundle.project, bundle.command
    head = bundle.state.head(bundle.name)
    if head is None and not bundle.number_of_observations:
        text = f"write 'POINTS {bundle.name} PHOTO' blocks into a .MEA file, then: orip run"
        return Step(command, "missing", f"bundle {bundle.name} has no photo points", text)
    if head is None:
        return Step(command, "missing", f"bundle {bundle.name} has not been adjusted")
    if not bundle.is_measured or record_key(bundle.name) not in bundle.records.bundles:
        return Step(command, "out of date", "its definition or photo observations no longer exist")
    if changed := changed_inputs(head.inputs, inputs_now(bundle)):
        return Step(command, "out of date", f"changed since: {', '.join(changed)}")
    if stale := stale_solution_outputs(project, bundle.name, head.run):
        names = ", ".join(project.shown(path) for path in stale)
        return Step(command, "out of date", f"missing or older than the last adjustment: {names}; {WRITTEN_BY}")
    return _of_head(command, head, has_images=any(photo.image for photo in bundle.records.photos.values()))


def inputs_now(bundle: BundleState) -> Digests:
    """Return name and digest of all that an adjustment of the bundle would be computed from now."""
    project = bundle.project
    return (*control_input_digests(project, bundle.name), *bundle.digests, project.heading_digest)


def _of_head(command: str, head: SolutionHead, *, has_images: bool) -> Step:
    found = f"{head.status.replace('_', ' ')}, sigma0 {head.sigma0:.4f}"
    if head.status == "doubtful":
        words = head.verdict.removeprefix("Converged, ").removeprefix("but ").removeprefix("with doubts: ")
        found = f"{found}: {words}{'; orip screen shows where' if has_images else ''}"
    if head.status == "stopped":
        return Step(command, "out of date", f"{found}: Ctrl-C ended it before it converged")
    if head.status in ("not_converged", "not_determined"):
        text = f"{found}: do not use its values; correct what the report names, then orip run"
        return Step(command, "failed", text, command.replace("solve", "report"))
    return Step(command, "up to date", found)
