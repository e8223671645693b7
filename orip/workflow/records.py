"""All definitions of a project as its stores hold them, read and written together."""

from __future__ import annotations

from dataclasses import dataclass

from orip.errors import InputError
from orip.files.stores import cameras, exterior, photos, templates, temticks
from orip.files.stores.definitions import StoredRecord
from orip.files.stores.transaction import Stores
from orip.interior.replay import Definitions
from orip.model.camera import Camera
from orip.model.names import record_key
from orip.model.photo import Photo, Template, Temtick
from orip.model.project import BundleDefinition
from orip.workflow.project import Project


@dataclass(frozen=True, slots=True)
class StoredDefinitions:
    """What the record stores define."""

    cameras: tuple[StoredRecord[Camera], ...]
    temticks: tuple[StoredRecord[Temtick], ...]
    templates: tuple[StoredRecord[Template], ...]
    photos: tuple[StoredRecord[Photo], ...]
    bundles: tuple[StoredRecord[BundleDefinition], ...]

    def by_name(self) -> Definitions:
        """Return the records by `record_key` of their names."""
        return Definitions(
            {record_key(each.record.name): each.record for each in self.cameras},
            {record_key(each.record.name): each.record for each in self.temticks},
            {record_key(each.record.name): each.record for each in self.templates},
            {record_key(each.record.name): each.record for each in self.photos},
            {record_key(each.record.name): each.record.name for each in self.bundles},
        )

    def bundle(self, name: str) -> BundleDefinition:
        """Return the definition of one bundle.

        Raises
        ------
        InputError
            If the store has none of that name.
        """
        for each in self.bundles:
            if record_key(each.record.name) == record_key(name):
                return each.record
        message = f"bundle {name} is in orip.toml but not yet in the stores; run 'orip init' first"
        raise InputError.single(message)


def read_definitions(project: Project, stores: Stores) -> StoredDefinitions:
    """Return all definitions; none where the stores are absent."""
    return StoredDefinitions(
        cameras.read(stores[project.cameras]),
        temticks.read(stores[project.temticks]),
        templates.read(stores[project.templates]),
        photos.read(stores[project.photos]),
        exterior.read(stores[project.exterior]),
    )


def write_definitions(project: Project, stores: Stores, old: StoredDefinitions, new: StoredDefinitions) -> bool:
    """Write the kinds of records that differ; return whether any does."""
    if new == old:
        return False
    if new.cameras != old.cameras:
        cameras.write(stores[project.cameras], new.cameras)
    if new.temticks != old.temticks:
        temticks.write(stores[project.temticks], new.temticks)
    if new.templates != old.templates:
        templates.write(stores[project.templates], new.templates)
    if new.photos != old.photos:
        photos.write(stores[project.photos], new.photos)
    if new.bundles != old.bundles:
        exterior.write(stores[project.exterior], new.bundles)
    return True


def require_initialised(definitions: StoredDefinitions) -> None:
    """Raise InputError unless `orip init` has been run."""
    if not definitions.bundles and not definitions.photos:
        message = "the project has no record stores yet; run 'orip init' first (or 'orip run' for everything)"
        raise InputError.single(message)
