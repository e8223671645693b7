"""`orip status`: what the project has, which steps of the work are out of date, and what comes next."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence

from msgspec import Struct

from orip.annexes import DOWNLOAD_STEP, DRIVE_STEPS, STATION_STEPS, annex
from orip.errors import HOW_TO_COMPILE, NotCompiledError, ProjectWarning
from orip.files.stores.contents.definitions import NamedRecord, StoredRecord
from orip.files.stores.contents.solution_tables import SolutionHead
from orip.files.stores.digest import record_digest
from orip.files.text.regular_file import beginning
from orip.records.camera import Camera
from orip.records.names import record_key
from orip.records.photo import Photo, Temtick
from orip.report.run_mark import run_of_page
from orip.structs import replace
from orip.wording import counted
from orip.workflow.project.bundle_state import BundleState
from orip.workflow.project.definitions import StoredDefinitions
from orip.workflow.project.folder import ProjectFolder
from orip.workflow.project.images import image_warnings
from orip.workflow.project.outputs import is_interior_listing_stale, outputs_of_other_names, stale_solution_outputs
from orip.workflow.project.run_id import WRITTEN_BY, Step, changed_inputs, digest_of_records
from orip.workflow.project.state import Part, ProjectState
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


STATUS_FROM: tuple[Part, ...] = ("definitions", "digests", "replay", "heads")
"""What `project_status` needs of the stores."""

_HEAD_OF_REPORT = 4096


class ProjectStatus(Struct, frozen=True):
    """The state of a project.

    Parameters
    ----------
    counts : tuple of (str, int)
        Cameras, templates, photos, bundles defined; photo points measured; exposure stations, if there are any; names
        in the singular.
    steps : tuple of Step
        In the order of the work.
    next_command : str or None
        What comes next; None when everything is up to date.
    """

    project: ProjectFolder
    counts: tuple[tuple[str, int], ...]
    steps: tuple[Step, ...]
    next_command: str | None
    warnings: tuple[ProjectWarning, ...]


def project_status(state: ProjectState, link: str | None = None, *, is_there: bool = True) -> ProjectStatus:
    """Return the state of a project.

    Parameters
    ----------
    state : ProjectState
        With `STATUS_FROM`.
    link : str or None
        URL of a plate processor that is asked which drive table it has.
    is_there : bool
        It should answer; else nothing is said where it does not.
    """
    project = state.project
    bundles = [BundleState(state, name) for name in project.bundle_names]
    beside: list[ProjectWarning] = []
    steps = [*_station_steps(state), initialise_step(state), measure_step(state), *map(solve_step, bundles)]
    if all(step.state == "up to date" for step in steps):  # a drive table waits for all before it
        steps += _drive_steps(state)
    if link is not None and any(map(_is_driven(state), project.bundle_names)):
        download: Step | ProjectWarning = annex(DOWNLOAD_STEP).download_step(state, link)
        if isinstance(download, Step):
            steps.append(download)
        elif is_there:
            beside.append(download)
    text, stored = project.definition, state.definitions
    counts = (
        ("camera", _count(project, text.cameras, stored.cameras)),
        ("template", _count(project, text.templates, stored.templates)),
        ("photo", _count(project, text.photos, stored.photos)),
        ("bundle", len(bundles)),
        ("photo point", sum(bundle.number_of_observations for bundle in bundles)),
        *_stations(state),
    )
    following = next((step.following for step in steps if step.state != "up to date"), None)
    images = image_warnings(project.folder, *_photos_and_cameras(state))
    warnings = (*project.warnings, *_old_outputs(project), *_old_reports(state), *images, *beside)
    return ProjectStatus(project, counts, tuple(steps), following, warnings)


def _is_driven(state: ProjectState) -> Callable[[str], bool]:
    """Return whether a bundle has models to drive in, or a drive table of single photos."""
    project = state.project
    return lambda name: bool(state.definitions.bundle(name).models) or project.drive_table(name).is_file()


def _count(project: ProjectFolder, texts: Sequence[NamedRecord], stored: Sequence[StoredRecord[NamedRecord]]) -> int:
    """Return how many records the project has in text and store; others may keep their cameras in the same store."""
    own = (item.record for item in stored if item.origin in {None, project.definition.name})
    return len({record_key(record.name) for record in (*texts, *own)})


def _photos_and_cameras(state: ProjectState) -> tuple[tuple[Photo, ...], Mapping[str, Camera]]:
    """Return the photos and cameras of the stores, and those of the text that are not in them yet."""
    text, stored = state.project.definition, state.records
    photos = {record_key(photo.name): photo for photo in text.photos} | dict(stored.photos)
    return tuple(photos.values()), {record_key(camera.name): camera for camera in text.cameras} | dict(stored.cameras)


def _stations(state: ProjectState) -> Iterator[tuple[str, int]]:
    """Yield the number of exposure stations, of which most projects have none."""
    if count := len(state.texts.stations.value):
        yield "exposure station", count


def _station_steps(state: ProjectState) -> list[Step]:
    if not state.project.definition.has_receivers:  # few projects have files of receivers
        return []
    return list(annex(STATION_STEPS).station_steps(state))


def _drive_steps(state: ProjectState) -> Iterator[Step]:
    for name in state.project.bundle_names:
        if state.definitions.bundle(name).models:
            driving = annex(DRIVE_STEPS)  # few bundles have models
            bundle = state.read_again(*driving.DRIVEN_FROM, bundles=[name])
            step: Step | None = driving.drive_step(BundleState(bundle, name))
            if step is not None:
                yield step


def observation_loop() -> str:
    """Return whether this installation has the compiled loops over photo points, rays and lines of logs."""
    from orip.bundle.compiled import photo_loop
    from orip.files.log import text as plain_lines
    from orip.prelim import compiled

    if not compiled.is_compiled():
        return "without preliminary values, and slower: the extensions are not built, as no C compiler was found"
    is_whole = photo_loop.is_compiled() and plain_lines.is_compiled()
    return "compiled" if is_whole else "NumPy (slower: not all extensions are built, as no C compiler was found)"


def not_compiled() -> tuple[ProjectWarning, ...]:
    """Return the warning of an installation that lacks a compiled loop; none where all are there.

    Raises
    ------
    NotCompiledError
        If preliminary values cannot be computed: an adjustment begins with them, or asks them when in doubt.
    """
    from orip.prelim import compiled

    if not compiled.is_compiled():
        raise NotCompiledError
    if observation_loop() == "compiled":
        return ()
    text = f"this installation lacks compiled loops, so that it takes many times longer; {HOW_TO_COMPILE}"
    return (ProjectWarning("not-compiled", "", text),)


def _old_outputs(project: ProjectFolder) -> list[ProjectWarning]:
    text = "was written when the project had another number of bundles, and is no longer written; remove it"
    return [ProjectWarning("old-output", project.shown(path), text) for path in outputs_of_other_names(project)]


def _old_reports(state: ProjectState) -> Iterator[ProjectWarning]:
    project = state.project
    for bundle in project.bundle_names:
        path, head = project.report(bundle), state.head(bundle)
        if head is None or not path.is_file():
            continue
        if run_of_page(beginning(path, _HEAD_OF_REPORT)) != head.run:
            text = "is older than the last adjustment; 'orip report' writes it again"
            yield ProjectWarning("old-report", project.shown(path), text)
