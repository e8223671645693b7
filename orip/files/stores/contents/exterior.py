"""The store of exterior orientation (.EXT): definitions of bundle adjustments with their stereo models."""

from __future__ import annotations

from collections.abc import Iterable

from orip.files.stores.contents.definitions import DefinitionTables, StoredRecord, definition_table, record_list
from orip.files.stores.store import Store
from orip.files.stores.table import list_table, text
from orip.records.project.definition import BundleDefinition, StereoModel

BUNDLE = definition_table("bundle", BundleDefinition)
DATUM_POINT = list_table("datum_point", "bundle", (text("point"),))
MODEL = record_list("model", "bundle", StereoModel)
TABLES = (BUNDLE, DATUM_POINT, MODEL)

_BUNDLES = DefinitionTables(BundleDefinition, BUNDLE, {"datum_points": DATUM_POINT, "models": MODEL})


def read(store: Store) -> tuple[StoredRecord[BundleDefinition], ...]:
    """Return all definitions of bundle adjustments in their order."""
    return _BUNDLES.read(store)


def write(store: Store, stored: Iterable[StoredRecord[BundleDefinition]]) -> None:
    """Replace all definitions; solutions stay, also those of bundles that are no longer defined."""
    _BUNDLES.write(store, stored)
