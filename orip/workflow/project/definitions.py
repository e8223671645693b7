"""Definitions and measurements of a project as its stores hold them, read and written together."""

from __future__ import annotations

from collections.abc import Container, Iterator, Mapping, Sequence
from pathlib import Path

from msgspec import Struct

from orip.errors import InputError
from orip.files.stores.contents import observations
from orip.files.stores.contents.definitions import NamedRecord, StoredRecord
from orip.files.stores.contents.stores import (
    BUNDLES,
    CAMERAS,
    PHOTO_ORIENTATIONS,
    PHOTOS,
    TEMPLATE_ORIENTATIONS,
    TEMPLATES,
    TEMTICKS,
    read_bundles,
)
from orip.files.stores.digest import record_digest, run_of
from orip.files.stores.transaction import Stores
from orip.interior.definitions import Definitions
from orip.records.camera import Camera, lens_key, with_shared_lenses
from orip.records.definition import BundleDefinition
from orip.records.measurement import Measured, no_observations
from orip.records.names import record_key
from orip.records.photo import Photo, Template, Temtick
from orip.structs import replace
from orip.wording import first_names
from orip.workflow.project.folder import ProjectFolder
from orip.workflow.project.run_id import digest_of_columns, digest_of_observations

_SHOWN_MISSING = 5


class StoredDefinitions(Struct, frozen=True):
    """What the record stores define."""

    cameras: tuple[StoredRecord[Camera], ...]
    temticks: tuple[StoredRecord[Temtick], ...]
    templates: tuple[StoredRecord[Template], ...]
    photos: tuple[StoredRecord[Photo], ...]
    bundles: tuple[StoredRecord[BundleDefinition], ...]

    def by_name(self) -> Definitions:
        """Return the records by `record_key` of their names."""
        return Definitions(
            {record_key(stored.record.name): stored.record for stored in self.cameras},
            {record_key(stored.record.name): stored.record for stored in self.temticks},
            {record_key(stored.record.name): stored.record for stored in self.templates},
            {record_key(stored.record.name): stored.record for stored in self.photos},
            {record_key(stored.record.name): stored.record.name for stored in self.bundles},
            {record_key(stored.record.name): stored.record for stored in self.bundles},
        )

    def bundle(self, name: str) -> BundleDefinition:
        """Return the definition of a bundle.

        Raises
        ------
        InputError
            If it is not in the stores.
        """
        for stored in self.bundles:
            if record_key(stored.record.name) == record_key(name):
                return stored.record
        message = f"bundle {name} is not in the record stores; run 'orip init' first"
        raise InputError.single(message)

    @property
    def are_empty(self) -> bool:
        """Tell whether no command has written definitions yet."""
        return not any((self.cameras, self.photos, self.bundles))


def read_definitions(project: ProjectFolder, stores: Stores) -> StoredDefinitions:
    """Return all definitions; none where the stores are absent."""
    return StoredDefinitions(
        _with_shared_lenses(CAMERAS.read(stores[project.cameras])),
        TEMTICKS.read(stores[project.temticks]),
        TEMPLATES.read(stores[project.templates]),
        PHOTOS.read(stores[project.photos]),
        read_bundles(stores[project.exterior]),
    )


def _with_shared_lenses(stored: Sequence[StoredRecord[Camera]]) -> tuple[StoredRecord[Camera], ...]:
    """Return cameras, those with the lens of another one as that lens is now."""
    records = with_shared_lenses(camera.record for camera in stored)
    return tuple(replace(camera, record=record) for camera, record in zip(stored, records, strict=True))


def write_definitions(project: ProjectFolder, stores: Stores, old: StoredDefinitions, new: StoredDefinitions) -> None:
    """Write the kinds of records that differ."""
    if new.cameras != old.cameras:
        CAMERAS.write(stores[project.cameras], new.cameras)
    if new.temticks != old.temticks:
        TEMTICKS.write(stores[project.temticks], new.temticks)
    if new.templates != old.templates:
        TEMPLATES.write(stores[project.templates], new.templates)
    if new.photos != old.photos:
        PHOTOS.write(stores[project.photos], new.photos)
    if new.bundles != old.bundles:
        BUNDLES.write(stores[project.exterior], new.bundles)


def require_initialised(project: ProjectFolder, definitions: StoredDefinitions) -> None:
    """Raise InputError unless the stores hold all that orip.toml defines, and all that their records refer to.

    A store may be missing, or come from elsewhere.
    """
    if definitions.are_empty:
        message = "the project has no record stores yet; run 'orip init' first (or 'orip run' for everything)"
        raise InputError.single(message)
    missing = list(dict.fromkeys((*_not_in_stores(project, definitions), *_dangling(definitions))))
    if missing:
        message = f"not in the record stores: {first_names(missing, _SHOWN_MISSING)}; run 'orip init' first"
        raise InputError.single(message)


def _not_in_stores(project: ProjectFolder, definitions: StoredDefinitions) -> Iterator[str]:
    text, stored = project.definition, definitions.by_name()
    kinds: list[tuple[str, Sequence[NamedRecord], Container[str]]] = [
        ("camera", text.cameras, stored.cameras),
        ("temtick", text.temticks, stored.temticks),
        ("template", text.templates, stored.templates),
        ("photo", text.photos, stored.photos),
        ("bundle", text.bundles, stored.bundles),
    ]
    for kind, records, there in kinds:
        yield from (f"{kind} {record.name}" for record in records if record_key(record.name) not in there)


def _dangling(definitions: StoredDefinitions) -> Iterator[str]:
    stored = definitions.by_name()
    for camera in stored.cameras.values():
        if lens_key(camera) not in stored.cameras:
            yield f"camera {camera.same_lens_as}"
    for template in stored.templates.values():
        if record_key(template.temtick) not in stored.temticks:
            yield f"temtick {template.temtick}"
    for photo in stored.photos.values():
        if record_key(photo.camera) not in stored.cameras:
            yield f"camera {photo.camera}"
        if photo.template is not None and record_key(photo.template) not in stored.templates:
            yield f"template {photo.template}"


def measured_stores(project: ProjectFolder) -> tuple[Path, ...]:
    """Return the stores that a replay writes."""
    bundles = (project.observations(name) for name in project.bundle_names)
    return project.templates, project.photos, *bundles


def read_marks(project: ProjectFolder, stores: Stores) -> Measured:
    """Return the orientations by marks that the stores hold; no photo observations."""
    return Measured(
        TEMPLATE_ORIENTATIONS.read(stores[project.templates]), PHOTO_ORIENTATIONS.read(stores[project.photos])
    )


class MeasuredDigests(Struct, frozen=True):
    """What tells measurements from others.

    Parameters
    ----------
    photos : tuple of str
        Digests of the orientations of photos by marks.
    observations : mapping of str to (int, str)
        Number and digest of the photo observations, by `record_key` of their bundle.
    """

    photos: tuple[str, ...]
    observations: Mapping[str, tuple[int, str]]


def digests_of(measured: Measured) -> MeasuredDigests:
    """Return what tells measurements from others."""
    observed = measured.observations.items()
    return MeasuredDigests(
        tuple(map(record_digest, measured.photos.values())),
        {key: (len(found.points), digest_of_observations(found)) for key, found in observed},
    )


def read_digests(project: ProjectFolder, stores: Stores, bundles: Sequence[str]) -> MeasuredDigests:
    """Return what tells the measurements that the stores hold from others, without making arrays of them."""
    read = ((record_key(name), observations.read_plain(stores[project.observations(name)])) for name in bundles)
    return MeasuredDigests(
        PHOTO_ORIENTATIONS.digests(stores[project.photos]),
        {
            key: (len(found.points), digest_of_columns((found.photos, found.points), found.numbers))
            for key, found in read
            if found is not None
        },
    )


def write_measured(project: ProjectFolder, stores: Stores, measured: Measured) -> None:
    """Replace what the stores hold of measurements."""
    TEMPLATE_ORIENTATIONS.write(stores[project.templates], measured.templates.values())
    PHOTO_ORIENTATIONS.write(stores[project.photos], measured.photos.values())
    for bundle in project.bundle_names:
        found = measured.observations.get(record_key(bundle), no_observations(bundle))
        observations.write(stores[project.observations(bundle)], found)


def runs_of_measurements(project: ProjectFolder, stores: Stores) -> tuple[str | None, ...]:
    """Return the run that wrote each of the `measured_stores`; equal where they belong together."""
    return tuple(run_of(stores[path]) for path in measured_stores(project))
