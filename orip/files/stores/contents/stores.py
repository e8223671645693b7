"""Definitions and measured marks in their stores: .CAM, .TIK, .PHO, .TEM, and the bundles in .EXT.

Photos and templates have the marks that orient them beside their definitions. These stay when definitions are replaced,
also those of photos and templates that are no longer defined; so do the solutions of bundles.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any, Generic, TypeVar, get_args

from msgspec import Struct

from orip.errors import Complaint, InputError
from orip.files.project.file_names import bundle_name_fault
from orip.files.stores.contents.definitions import (
    DefinitionTables,
    StoredRecord,
    definition_table,
    record_list,
    refuse_case_twins,
)
from orip.files.stores.digest import record_digest
from orip.files.stores.store import Row, Store, damage
from orip.files.stores.table import StoreTable, flag, list_table, real, record_name, text
from orip.files.text.shown import shown_token
from orip.records.camera import CAMERA_PARAMETERS, Camera, Mark
from orip.records.definition import BundleDefinition, StereoModel
from orip.records.measurement import (
    MeasuredMarks,
    PhotoOrientation,
    TemplateOrientation,
    TransformationKind,
)
from orip.records.names import record_key
from orip.records.photo import PHOTO_PARAMETERS, Photo, Stage, Template, Temtick

Orientation = TypeVar("Orientation", bound=PhotoOrientation | TemplateOrientation)

TRANSFORMATION = text("transformation", get_args(TransformationKind))


def measured_marks_table(name: str, owner: str, parent: str) -> StoreTable:
    """Return the table of measured marks; their own given coordinates are NULL where a record has them."""
    columns = (text("name"), real("x"), real("y"), flag("disregarded"), real("given_x", "nan"), real("given_y", "nan"))
    return list_table(name, owner, columns, "name", parent=parent)


def measured_rows(marks: MeasuredMarks) -> list[Row]:
    """Return measured marks as rows."""
    import numpy as np

    coordinates = np.column_stack([marks.measured, marks.given]).tolist() if marks.names else []
    return [
        (name, x, y, bool(disregarded), given_x, given_y)
        for name, (x, y, given_x, given_y), disregarded in zip(marks.names, coordinates, marks.disregarded, strict=True)
    ]


def measured_of(rows: Sequence[Row]) -> MeasuredMarks:
    """Return rows as measured marks."""
    import numpy as np

    numbers = np.array([(x, y, given_x, given_y) for _name, x, y, _off, given_x, given_y in rows], dtype=np.float64)
    numbers = numbers.reshape(len(rows), 4)
    return MeasuredMarks(
        names=tuple(row[0] for row in rows),
        measured=numbers[:, :2].copy(),
        disregarded=np.array([row[3] for row in rows], dtype=np.bool_),
        given=numbers[:, 2:].copy(),
    )


def plain_marks(rows: Sequence[Row]) -> MeasuredMarks:
    """Return rows as `measured_of` does, with lists in place of arrays: what has the same digest."""
    measured: Any = [[x, y] for _name, x, y, *_ in rows]
    given: Any = [[x, y] for *_, x, y in rows]
    disregarded: Any = [row[3] for row in rows]
    return MeasuredMarks(tuple(row[0] for row in rows), measured, disregarded, given)


class OrientationTables(Struct, Generic[Orientation], frozen=True):
    """How orientations by marks lie in their tables; columns have the names of the record's fields, marks come last.

    Orientations refer to no definition: they are what replaying the measurements left, whatever is defined now.

    Parameters
    ----------
    table : StoreTable
        Its first column is the name of the photo or template.
    marks : StoreTable
        From `measured_marks_table`.
    """

    kind: Callable[..., Orientation]
    table: StoreTable
    marks: StoreTable

    @property
    def tables(self) -> tuple[StoreTable, ...]:
        """Return both tables."""
        return self.table, self.marks

    def read(self, store: Store) -> dict[str, Orientation]:
        """Return the orientations by the `record_key` of their photo or template, sorted by name."""
        marks = store.lists(self.marks)
        return {
            record_key(name): self.kind(name, *values, measured_of(marks.get(record_key(name), [])))
            for name, *values in store.rows(self.table)
        }

    def digests(self, store: Store) -> tuple[str, ...]:
        """Return the digests of the orientations, in the order in which they are read."""
        marks = store.lists(self.marks)
        return tuple(
            record_digest(self.kind(name, *values, plain_marks(marks.get(record_key(name), []))))
            for name, *values in store.rows(self.table)
        )

    def write(self, store: Store, orientations: Iterable[Orientation]) -> None:
        """Replace all orientations."""
        everything, columns = tuple(orientations), self.table.column_names
        names = [getattr(item, columns[0]) for item in everything]
        refuse_case_twins(store, self.table.name, names)
        store.delete(self.table)
        store.insert(self.table, (tuple(getattr(item, column) for column in columns) for item in everything))
        for name, item in zip(names, everything, strict=True):
            store.insert(self.marks, ((name, place, *row) for place, row in enumerate(measured_rows(item.marks))))


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
