"""The store of exterior orientation (.EXT): definitions of bundle adjustments with their stereo models."""

from __future__ import annotations

from collections.abc import Iterable

from orip.errors import Complaint, InputError
from orip.files.project.file_names import bundle_name_fault
from orip.files.stores.contents.definitions import DefinitionTables, StoredRecord, definition_table, record_list
from orip.files.stores.store import Store, damage
from orip.files.stores.table import list_table, record_name, text
from orip.files.text.shown import shown_token
from orip.records.definition import BundleDefinition, StereoModel

BUNDLE = definition_table("bundle", BundleDefinition)
CAMERA = list_table("camera_in_place", "bundle", (record_name("camera"), record_name("other")))
DATUM_POINT = list_table("datum_point", "bundle", (text("point"),))
MODEL = record_list("model", "bundle", StereoModel)
TABLES = (BUNDLE, CAMERA, DATUM_POINT, MODEL)

_BUNDLES = DefinitionTables(BundleDefinition, BUNDLE, {"datum_points": DATUM_POINT, "models": MODEL, "cameras": CAMERA})


def read(store: Store) -> tuple[StoredRecord[BundleDefinition], ...]:
    """Return all definitions of bundle adjustments in their order.

    Raises
    ------
    InputError
        If a bundle has a name that no command would have given it: files are called after bundles.
    """
    found = _BUNDLES.read(store)
    for one in found:
        if fault := bundle_name_fault(one.record.name):
            raise damage(store.path, f"bundle '{shown_token(one.record.name)}' {fault}")
    return found


def require_names(store: Store, source: str) -> None:
    """Refuse the definitions of a dump if a bundle has a name that cannot be that of files.

    Raises
    ------
    InputError
    """
    faults = [(one.record.name, bundle_name_fault(one.record.name)) for one in _BUNDLES.read(store)]
    complaints = [
        Complaint(f"bundle '{shown_token(name)}' {fault}; its files have the same name, correct it", source)
        for name, fault in faults
        if fault is not None
    ]
    if complaints:
        raise InputError(complaints)


def write(store: Store, stored: Iterable[StoredRecord[BundleDefinition]]) -> None:
    """Replace all definitions; solutions stay, also those of bundles that are no longer defined."""
    _BUNDLES.write(store, stored)
