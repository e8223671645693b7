"""The measurements of a record that is renamed or deleted."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path

from orip.errors import InputError
from orip.files.stores.contents import observations, photos, templates
from orip.files.stores.provenance import run_of, set_run
from orip.files.stores.store import Store
from orip.files.stores.transaction import Stores
from orip.files.text.regular_file import file_of
from orip.records.coded_names import coded
from orip.records.names import record_key
from orip.records.observations.measurement import Measured, PhotoObservations
from orip.structs import replace
from orip.wording import counted
from orip.workflow.project.folder import ProjectFolder
from orip.workflow.records.changes import Renaming
from orip.workflow.records.references import RecordKind


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
    old = list(templates.ORIENTATIONS.read(store).values())
    new = [replace(reading, template=name) for reading in old if (name := new_name(reading.template)) is not None]
    if [reading.template for reading in new] != [reading.template for reading in old]:
        templates.ORIENTATIONS.write(store, new)


def _write_photos(project: ProjectFolder, stores: Stores, bundles: Sequence[str], new_name: _NewName) -> None:
    store = stores[project.photos]
    old = list(photos.ORIENTATIONS.read(store).values())
    new = [replace(reading, photo=name) for reading in old if (name := new_name(reading.photo)) is not None]
    if [reading.photo for reading in new] != [reading.photo for reading in old]:
        photos.ORIENTATIONS.write(store, new)
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
