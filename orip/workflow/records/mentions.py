"""The measurements and texts that name a record which is renamed or deleted, and the files of a renamed bundle."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path

from orip.errors import InputError, OripError, ProjectWarning
from orip.files.stores.contents import observations, solutions
from orip.files.stores.contents.stores import PHOTO_ORIENTATIONS, TEMPLATE_ORIENTATIONS
from orip.files.stores.digest import run_of, set_run
from orip.files.stores.store import Store
from orip.files.stores.transaction import Stores
from orip.files.text.atomic import replace_bytes
from orip.files.text.regular_file import file_of, regular_bytes
from orip.records.coded_names import coded
from orip.records.control import Control
from orip.records.measurement import (
    EditRecord,
    FiducialsRecord,
    LogRecord,
    Measured,
    PhotoObservations,
    PhotoRecord,
    PointsRecord,
    TemplateRecord,
    TicksRecord,
)
from orip.records.names import record_key
from orip.records.results.solution import Solution
from orip.structs import replace
from orip.wording import counted
from orip.workflow.project.definitions import StoredDefinitions
from orip.workflow.project.folder import ProjectFolder
from orip.workflow.project.run_id import digest_of_records, run_id
from orip.workflow.project.state import ProjectState
from orip.workflow.records.changes import RecordChange, Renaming
from orip.workflow.records.document import RecordKind


def mention_warnings(state: ProjectState, changes: tuple[RecordChange, ...]) -> Iterator[ProjectWarning]:
    """Warn of each text that still uses the old name of a record."""
    gone = [
        change
        for change in changes
        if change.action in {"renamed", "deleted"}
        and record_key(change.old_name) != record_key(change.name)
        and change.kind != "model"  # a model is part of its bundle, whose text is applied as a whole
    ]
    if not gone:
        return
    project = state.project
    log, control = state.texts.log.value.records, state.texts.control.value
    base = project.definition.control_files
    for change in gone:
        name = change.old_name or change.name
        now = f"is called {change.name} now" if change.old_name else "is deleted"
        yield from _in_project_text(project, change, name, now)
        yield from _shared(project, state.definitions, change, name)
        for path, line in dict(
            reversed([_place(record) for record in log if _mentions(record, change.kind, name)])
        ).items():
            text = f"{change.kind} {name} {now}, but is still measured here; correct it before the next 'orip measure'"
            yield ProjectWarning("still-in-measurements", f"{path}:{line}", text)
        for extension, line in _observed_in_texts(control, change.kind, name):
            text = f"{change.kind} {name} {now}, but is still observed here; correct this line"
            yield ProjectWarning("still-in-control", f"{base}.{extension}:{line}", text)


def _observed_in_texts(control: Control, kind: str, name: str) -> Iterator[tuple[str, int]]:
    """Iterate over the lines of control texts, with the extension of the text, that observe a record."""
    for element in control.elements:
        if element.group.lower() == kind and record_key(element.name) == record_key(name):
            yield "ELE", element.line
    for station in control.stations:
        if kind == "photo" and record_key(station.photo) == record_key(name):
            yield "STA", station.line
    for line in control.differences:
        if kind == "photo" and record_key(name) in {record_key(line.first), record_key(line.second)}:
            yield "REL", line.line


def _in_project_text(project: ProjectFolder, change: RecordChange, name: str, now: str) -> Iterator[ProjectWarning]:
    line = project.lines.get((change.kind, record_key(name)))
    if line is not None:
        text = (
            f"{change.kind} {name} {now}, but is still in the text, and the next 'orip init' brings it back; correct "
            f"the text, or let 'orip export-toml --output orip.toml --force' do it"
        )
        yield ProjectWarning("still-in-text", f"{project.shown(project.text)}:{line}", text)


def _shared(
    project: ProjectFolder, before: StoredDefinitions, change: RecordChange, name: str
) -> Iterator[ProjectWarning]:
    stored = before.cameras if change.kind == "camera" else before.temticks if change.kind == "temtick" else ()
    for record in stored:
        if record_key(record.record.name) == record_key(name) and record.origin not in {None, project.definition.name}:
            text = f"comes from project {record.origin}, which may still use it"
            yield ProjectWarning("shared-record", f"{change.kind} {name}", text)


def _place(record: LogRecord) -> tuple[str, int]:
    return record.place.path, record.place.line


def _mentions(record: LogRecord, kind: str, name: str) -> bool:
    return record_key(name) in {record_key(mentioned) for mentioned in _names(record, kind)}


def _names(record: LogRecord, kind: str) -> Iterator[str]:
    """Iterate over the names of records of a kind in a record of a measurement log."""
    match kind, record:
        case ("photo", PointsRecord() | PhotoRecord()):
            yield record.photo
        case ("photo", EditRecord()):
            yield record.owner if record.what != "TICK" else ""
        case ("template", EditRecord()):
            yield record.owner if record.what == "TICK" else ""
        case ("bundle", PointsRecord()):
            yield record.bundle
        case ("bundle", EditRecord()):
            yield record.bundle or ""
        case ("template", TemplateRecord()):
            yield record.template
        case ("camera", FiducialsRecord()):
            yield record.camera
        case ("temtick", TicksRecord()):
            yield record.temtick


def is_written(path: Path) -> bool:
    """Tell whether there is a store to read and to change; an absent one is not created."""
    return path.is_file() and path.stat().st_size > 0


def measurements_of(measured: Measured, kind: RecordKind, name: str) -> Iterator[str]:
    """Say what is measured of a record."""
    key = record_key(name)
    if kind == "photo" and key in measured.photos:
        yield counted(len(measured.photos[key].marks.names), "measured fiducial mark")
    if kind == "template" and key in measured.templates:
        yield counted(len(measured.templates[key].marks.names), "measured tick mark")
    for bundle, found in measured.observations.items():
        if kind == "bundle" and bundle == key and found.points:
            yield counted(len(found.points), "measured photo point")
        if kind == "photo" and (count := sum(record_key(photo) == key for photo in found.photos)):
            yield f"{counted(count, 'measured photo point')} of {found.bundle}"


def rename_measurements(project: ProjectFolder, stores: Stores, bundles: Sequence[str], renaming: Renaming) -> None:
    """Give measurements the new name of their photo, template or bundle."""
    key, new = record_key(renaming.old), renaming.new
    if renaming.kind == "template":
        _write_templates(project, stores, lambda name: new if record_key(name) == key else name)
    if renaming.kind == "photo":
        _write_photos(project, stores, bundles, lambda name: new if record_key(name) == key else name)
    if renaming.kind == "bundle":
        _rename_observations(project, stores, renaming)


def delete_measurements(
    project: ProjectFolder, stores: Stores, bundles: Sequence[str], kind: RecordKind, names: Iterable[str]
) -> None:
    """Delete the measurements of records."""
    keys = {record_key(name) for name in names}
    if not keys:
        return
    if kind == "template":
        _write_templates(project, stores, lambda name: None if record_key(name) in keys else name)
    if kind == "photo":
        _write_photos(project, stores, bundles, lambda name: None if record_key(name) in keys else name)
    if kind == "bundle":
        for bundle, _ in _observed(project, stores, bundles):
            if record_key(bundle) in keys:
                _empty(stores[project.observations(bundle)])


_NewName = Callable[[str], str | None]
"""The name that a record will have; None: it will be gone."""


def _write_templates(project: ProjectFolder, stores: Stores, new_name: _NewName) -> None:
    store = stores[project.templates]
    old = list(TEMPLATE_ORIENTATIONS.read(store).values())
    new = [replace(reading, template=name) for reading in old if (name := new_name(reading.template)) is not None]
    if [reading.template for reading in new] != [reading.template for reading in old]:
        TEMPLATE_ORIENTATIONS.write(store, new)


def _write_photos(project: ProjectFolder, stores: Stores, bundles: Sequence[str], new_name: _NewName) -> None:
    store = stores[project.photos]
    old = list(PHOTO_ORIENTATIONS.read(store).values())
    new = [replace(reading, photo=name) for reading in old if (name := new_name(reading.photo)) is not None]
    if [reading.photo for reading in new] != [reading.photo for reading in old]:
        PHOTO_ORIENTATIONS.write(store, new)
    for bundle, measured in _observed(project, stores, bundles):
        found = _with_photos(measured, new_name)
        if found.photos != measured.photos:
            observations.write(stores[project.observations(bundle)], found)


def _with_photos(measured: PhotoObservations, new_name: _NewName) -> PhotoObservations:
    photos, points = coded(measured.photos), coded(measured.points)
    kept = photos.where(lambda photo: new_name(photo) is not None)
    return replace(
        measured,
        photos=coded(photos[kept].values(lambda photo: new_name(photo) or "")),
        points=points[kept],
        measured=measured.measured[kept],
        errors=measured.errors[kept],
        disregarded=measured.disregarded[kept],
    )


def _rename_observations(project: ProjectFolder, stores: Stores, renaming: Renaming) -> None:
    old, new = project.observations(renaming.old), project.observations(renaming.new)
    if not is_written(old):
        return
    store = stores[old]
    measured = observations.read(store)
    if measured is None:
        return
    if file_of(new) != file_of(old) and observations.read(stores[new]) is not None:
        message = f"{project.shown(new)} holds photo observations already; move it away"
        raise InputError.single(message)
    observations.write(stores[new], replace(measured, bundle=renaming.new))
    if file_of(new) != file_of(old):
        set_run(stores[new], run_of(store))
        _empty(store)


def _empty(store: Store) -> None:
    store.delete(observations.BUNDLE)
    store.delete(observations.OBSERVATION)


def _observed(
    project: ProjectFolder, stores: Stores, bundles: Iterable[str]
) -> Iterator[tuple[str, PhotoObservations]]:
    """Iterate over the bundles that have photo observations."""
    for bundle in bundles:
        path = project.observations(bundle)
        if is_written(path):
            found = observations.read(stores[path])
            if found is not None:
                yield bundle, found


# Its measurements are renamed in `orip.workflow.records.mentions`.


def rename_solution(state: ProjectState, stores: Stores, renaming: Renaming, after: StoredDefinitions) -> None:
    """Give the solution of a bundle its new name.

    It stays as current as it was. Its run id changes, so that the listings of the old name are written again.
    """
    solution, store = state.solution(renaming.old), stores[state.project.exterior]
    if solution is None:
        return
    solutions.delete(store, renaming.old)
    inputs = _renamed_inputs(state.project, solution, renaming, state.definitions, after)
    run = run_id("rename", solution.run, renaming.new)
    solutions.write(store, replace(solution, bundle=renaming.new, inputs=inputs, run=run))


def _renamed_inputs(
    project: ProjectFolder, solution: Solution, renaming: Renaming, before: StoredDefinitions, after: StoredDefinitions
) -> tuple[tuple[str, str], ...]:
    """Return what a solution depends on, with the new names; what has changed since still differs."""
    old, new = renaming.old, renaming.new
    names = {
        project.shown(project.observations(old)): project.shown(project.observations(new)),
        project.shown(project.preliminary(old)): project.shown(project.preliminary(new)),
    }
    digests = {digest_of_records([before.bundle(old)]): digest_of_records([after.bundle(new)])}
    return tuple((names.get(name, name), digests.get(digest, digest)) for name, digest in solution.inputs)


def require_free_file(project: ProjectFolder, renaming: Renaming) -> None:
    """Refuse a name for which preliminary coordinates already exist.

    Raises
    ------
    InputError
    """
    old, new = project.preliminary(renaming.old), project.preliminary(renaming.new)
    if record_key(renaming.old) == record_key(renaming.new) or not new.is_file():
        return
    if not (old.is_file() and regular_bytes(old) == regular_bytes(new)):  # else a run was killed before it had renamed
        message = f"{project.shown(new)} already exists; move it away, or choose another name"
        raise InputError.single(message)


def copy_preliminary(project: ProjectFolder, renaming: Renaming) -> None:
    """Copy BUNDLE.PRE before the commit; the old one is removed after it: its points exist at every instant.

    Raises
    ------
    OripError
        If the file cannot be read or written.
    """
    old = project.preliminary(renaming.old)
    if not old.is_file():
        return
    new = project.preliminary(renaming.new)
    try:
        replace_bytes(new, regular_bytes(old))
    except OSError as error:
        reason = error.strerror or error
        message = f"{project.shown(old)} cannot be copied to {project.shown(new)}: {reason}; nothing was renamed"
        raise OripError(message) from error


def files_of_old_name(
    project: ProjectFolder, renaming: Renaming
) -> tuple[tuple[Path, ...], tuple[ProjectWarning, ...]]:
    """Return the files that are named after a renamed bundle, and a warning about the results in them."""
    if renaming.old == renaming.new:
        return (), ()
    sources = (project.observations(renaming.old), project.preliminary(renaming.old))
    kept = _results(project, renaming.new)
    results = [path for path in _results(project, renaming.old) if path not in kept and path.is_file()]
    if not results:
        return sources, ()
    text = (
        f"results under the old name were removed: {', '.join(map(project.shown, results))}. Rename the bundle in "
        "orip.toml, then run 'orip run' to write them again"
    )
    return (*sources, *results), (ProjectWarning("renamed-bundle", "", text),)


def _results(project: ProjectFolder, bundle: str) -> Sequence[Path]:
    return (
        *project.outputs(bundle).all,
        project.preliminary_listing(bundle),
        project.report(bundle),
        project.drive_table(bundle),
    )
