"""The store of cameras (.CAM)."""

from __future__ import annotations

from collections.abc import Iterable

from orip.files.stores.contents.definitions import DefinitionTables, StoredRecord, definition_table, record_list
from orip.files.stores.store import Store
from orip.files.stores.table import list_table, real, text
from orip.records.camera import CAMERA_PARAMETERS, Camera, Mark

CAMERA = definition_table("camera", Camera)
FIDUCIAL = record_list("fiducial", "camera", Mark)
UNKNOWN = list_table("unknown_parameter", "camera", (text("parameter", CAMERA_PARAMETERS),), "parameter")
CURVE = list_table("distortion_point", "camera", (real("radius"), real("distortion")))
TABLES = (CAMERA, FIDUCIAL, UNKNOWN, CURVE)

_CAMERAS = DefinitionTables(Camera, CAMERA, {"fiducials": FIDUCIAL, "unknown": UNKNOWN, "distortion_curve": CURVE})


def read(store: Store) -> tuple[StoredRecord[Camera], ...]:
    """Return all cameras in their order. A distortion curve without points is read as none given."""
    return _CAMERAS.read(store)


def write(store: Store, stored: Iterable[StoredRecord[Camera]]) -> None:
    """Replace all cameras."""
    _CAMERAS.write(store, stored)
