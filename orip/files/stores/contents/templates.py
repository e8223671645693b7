"""The store of templates (.TEM): definitions, and the tick marks that orient them on the stage plate."""

from __future__ import annotations

from collections.abc import Iterable
from typing import get_args

from orip.files.stores.contents.definitions import DefinitionTables, StoredRecord, definition_table
from orip.files.stores.contents.marks import TRANSFORMATION, OrientationTables, measured_marks_table
from orip.files.stores.store import Store
from orip.files.stores.table import StoreTable, list_table, record_name, text
from orip.records.measurement import TemplateOrientation
from orip.records.photo import Stage, Template

TEMPLATE = definition_table("template", Template)
TEMPLATE_PHOTO = list_table("template_photo", "template", (record_name("photo"),), "photo")
ORIENTATION = StoreTable(
    "template_orientation",
    (record_name("template"), TRANSFORMATION, text("stage", get_args(Stage), optional=True)),
    key=("template",),
)
MARK = measured_marks_table("template_mark", "template", parent="template_orientation")
TABLES = (TEMPLATE, TEMPLATE_PHOTO, ORIENTATION, MARK)

ORIENTATIONS = OrientationTables(TemplateOrientation, ORIENTATION, MARK)

_TEMPLATES = DefinitionTables(Template, TEMPLATE, {"photos": TEMPLATE_PHOTO})


def read(store: Store) -> tuple[StoredRecord[Template], ...]:
    """Return all templates in their order."""
    return _TEMPLATES.read(store)


def write(store: Store, stored: Iterable[StoredRecord[Template]]) -> None:
    """Replace all templates; template orientations stay, also those of templates that are no longer defined."""
    _TEMPLATES.write(store, stored)
