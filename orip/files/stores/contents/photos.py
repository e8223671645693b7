"""The store of photos (.PHO): definitions, and the fiducial marks that orient them."""

from __future__ import annotations

from collections.abc import Iterable

from orip.files.stores.contents.definitions import DefinitionTables, StoredRecord, definition_table
from orip.files.stores.contents.marks import TRANSFORMATION, OrientationTables, measured_marks_table
from orip.files.stores.store import Store
from orip.files.stores.table import StoreTable, list_table, record_name, text
from orip.records.measurement import PhotoOrientation
from orip.records.photo import PHOTO_PARAMETERS, Photo

PHOTO = definition_table("photo", Photo)
CONSTANT = list_table("constant_parameter", "photo", (text("parameter", PHOTO_PARAMETERS),), "parameter")
ORIENTATION = StoreTable("photo_orientation", (record_name("photo"), TRANSFORMATION), key=("photo",))
MARK = measured_marks_table("photo_mark", "photo", parent="photo_orientation")
TABLES = (PHOTO, CONSTANT, ORIENTATION, MARK)

ORIENTATIONS = OrientationTables(PhotoOrientation, ORIENTATION, MARK)

_PHOTOS = DefinitionTables(Photo, PHOTO, {"constant": CONSTANT})


def read(store: Store) -> tuple[StoredRecord[Photo], ...]:
    """Return all photos in their order."""
    return _PHOTOS.read(store)


def write(store: Store, stored: Iterable[StoredRecord[Photo]]) -> None:
    """Replace all photos; photo orientations stay, also those of photos that are no longer defined."""
    _PHOTOS.write(store, stored)
