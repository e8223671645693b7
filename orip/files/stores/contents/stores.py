"""Definitions in their stores: cameras (.CAM), temticks (.TIK), photos (.PHO), templates (.TEM), bundles (.EXT).

Photos and templates have the marks that orient them beside their definitions. These stay when definitions are replaced,
also those of photos and templates that are no longer defined; so do the solutions of bundles.
"""

from __future__ import annotations

from typing import get_args

from orip.errors import Complaint, InputError
from orip.files.project.file_names import bundle_name_fault
from orip.files.stores.contents.definitions import DefinitionTables, StoredRecord, definition_table, record_list
from orip.files.stores.contents.marks import TRANSFORMATION, OrientationTables, measured_marks_table
from orip.files.stores.store import Store, damage
from orip.files.stores.table import StoreTable, list_table, real, record_name, text
from orip.files.text.shown import shown_token
from orip.records.camera import CAMERA_PARAMETERS, Camera, Mark
from orip.records.definition import BundleDefinition, StereoModel
from orip.records.measurement import PhotoOrientation, TemplateOrientation
from orip.records.photo import PHOTO_PARAMETERS, Photo, Stage, Template, Temtick

CAMERAS = DefinitionTables(
    Camera,
    definition_table("camera", Camera),
    {
        "fiducials": record_list("fiducial", "camera", Mark),
        "unknown": list_table("unknown_parameter", "camera", (text("parameter", CAMERA_PARAMETERS),), "parameter"),
        "distortion_curve": list_table("distortion_point", "camera", (real("radius"), real("distortion"))),
    },
)
"""A distortion curve without points is read as none given."""

TEMTICKS = DefinitionTables(
    Temtick, definition_table("temtick", Temtick), {"ticks": record_list("tick", "temtick", Mark)}
)

PHOTOS = DefinitionTables(
    Photo,
    definition_table("photo", Photo),
    {"constant": list_table("constant_parameter", "photo", (text("parameter", PHOTO_PARAMETERS),), "parameter")},
)

PHOTO_ORIENTATIONS = OrientationTables(
    PhotoOrientation,
    StoreTable("photo_orientation", (record_name("photo"), TRANSFORMATION), key=("photo",)),
    measured_marks_table("photo_mark", "photo", parent="photo_orientation"),
)

TEMPLATES = DefinitionTables(
    Template,
    definition_table("template", Template),
    {"photos": list_table("template_photo", "template", (record_name("photo"),), "photo")},
)

TEMPLATE_ORIENTATIONS = OrientationTables(
    TemplateOrientation,
    StoreTable(
        "template_orientation",
        (record_name("template"), TRANSFORMATION, text("stage", get_args(Stage), optional=True)),
        key=("template",),
    ),
    measured_marks_table("template_mark", "template", parent="template_orientation"),
)

BUNDLES = DefinitionTables(
    BundleDefinition,
    definition_table("bundle", BundleDefinition),
    {
        "cameras": list_table("camera_in_place", "bundle", (record_name("camera"), record_name("other"))),
        "datum_points": list_table("datum_point", "bundle", (text("point"),)),
        "models": record_list("model", "bundle", StereoModel),
    },
)


def read_bundles(store: Store) -> tuple[StoredRecord[BundleDefinition], ...]:
    """Return all definitions of bundle adjustments in their order.

    Raises
    ------
    InputError
        If a bundle has a name that no command would have given it: files are called after bundles.
    """
    found = BUNDLES.read(store)
    for one in found:
        if fault := bundle_name_fault(one.record.name):
            raise damage(store.path, f"bundle '{shown_token(one.record.name)}' {fault}")
    return found


def require_names_of_bundles(store: Store, source: str) -> None:
    """Refuse the definitions of a dump if a bundle has a name that cannot be that of files.

    Raises
    ------
    InputError
    """
    faults = [(one.record.name, bundle_name_fault(one.record.name)) for one in BUNDLES.read(store)]
    complaints = [
        Complaint(f"bundle '{shown_token(name)}' {fault}; its files have the same name, correct it", source)
        for name, fault in faults
        if fault is not None
    ]
    if complaints:
        raise InputError(complaints)
