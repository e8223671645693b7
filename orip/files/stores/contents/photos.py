"""The store of photos (.PHO): definitions, and the fiducial marks that orient them."""

from __future__ import annotations

from collections.abc import Iterable

from orip.files.stores.contents.definitions import DefinitionTables, StoredRecord, definition_table, refuse_case_twins
from orip.files.stores.contents.marks import TRANSFORMATION, measured_marks_table, measured_of, measured_rows
from orip.files.stores.store import Store
from orip.files.stores.table import StoreTable, list_table, record_name, text
from orip.records.names import record_key
from orip.records.observations.measurement import PhotoOrientation
from orip.records.project.photo import PHOTO_PARAMETERS, Photo

PHOTO = definition_table("photo", Photo)
CONSTANT = list_table("constant_parameter", "photo", (text("parameter", PHOTO_PARAMETERS),), "parameter")
# Orientations refer to no definition: they are what replaying the measurements left, whichever photos are defined now.
ORIENTATION = StoreTable("photo_orientation", (record_name("photo"), TRANSFORMATION), key=("photo",))
MARK = measured_marks_table("photo_mark", "photo", parent="photo_orientation")
TABLES = (PHOTO, CONSTANT, ORIENTATION, MARK)

_PHOTOS = DefinitionTables(Photo, PHOTO, {"constant": CONSTANT})


def read(store: Store) -> tuple[StoredRecord[Photo], ...]:
    """Return all photos in their order."""
    return _PHOTOS.read(store)


def write(store: Store, stored: Iterable[StoredRecord[Photo]]) -> None:
    """Replace all photos; photo orientations stay, also those of photos that are no longer defined."""
    _PHOTOS.write(store, stored)


def read_orientations(store: Store) -> dict[str, PhotoOrientation]:
    """Return the photo orientations by the `record_key` of their photo, sorted by name."""
    marks = store.lists(MARK)
    return {
        record_key(photo): PhotoOrientation(photo, kind, measured_of(marks.get(record_key(photo), [])))
        for photo, kind in store.rows(ORIENTATION)
    }


def write_orientations(store: Store, orientations: Iterable[PhotoOrientation]) -> None:
    """Replace all photo orientations."""
    everything = tuple(orientations)
    refuse_case_twins(store, ORIENTATION.name, (orientation.photo for orientation in everything))
    store.delete(ORIENTATION)
    store.insert(ORIENTATION, ((orientation.photo, orientation.transformation) for orientation in everything))
    for item in everything:
        store.insert(MARK, ((item.photo, place, *row) for place, row in enumerate(measured_rows(item.marks))))
