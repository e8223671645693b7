"""`orip status`: what the project has, what is out of date, and what comes next."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence

from msgspec import Struct

from orip.annexes import DOWNLOAD_STEP, DRIVE_STEPS, STATION_STEPS, annex
from orip.errors import HOW_TO_COMPILE, NotCompiledError, ProjectWarning
from orip.files.stores.contents.definitions import NamedRecord, StoredRecord
from orip.files.text.regular_file import beginning
from orip.records.camera import Camera
from orip.records.names import record_key
from orip.records.photo import Photo
from orip.report.run_mark import run_of_page
from orip.workflow.project.bundle_state import BundleState
from orip.workflow.project.folder import ProjectFolder
from orip.workflow.project.images import image_warnings
from orip.workflow.project.outputs import outputs_of_other_names
from orip.workflow.project.run_id import Step
from orip.workflow.project.state import Part, ProjectState
from orip.workflow.steps import initialise_step, measure_step, solve_step

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
