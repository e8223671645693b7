"""The store of templates (.TEM): definitions, and the tick marks that orient them on the stage plate."""

from __future__ import annotations

from collections.abc import Iterable
from typing import get_args

from orip.files.stores.contents.definitions import DefinitionTables, StoredRecord, definition_table, refuse_case_twins
from orip.files.stores.contents.marks import TRANSFORMATION, measured_marks_table, measured_of, measured_rows
from orip.files.stores.store import Store
from orip.files.stores.table import StoreTable, list_table, record_name, text
from orip.records.names import record_key
from orip.records.observations.measurement import TemplateOrientation
from orip.records.project.photo import Stage, Template

TEMPLATE = definition_table("template", Template)
TEMPLATE_PHOTO = list_table("template_photo", "template", (record_name("photo"),), "photo")
# As with photos: what replaying the measurements left, whichever templates are defined now.
ORIENTATION = StoreTable(
    "template_orientation",
    (record_name("template"), TRANSFORMATION, text("stage", get_args(Stage), optional=True)),
    key=("template",),
)
MARK = measured_marks_table("template_mark", "template", parent="template_orientation")
TABLES = (TEMPLATE, TEMPLATE_PHOTO, ORIENTATION, MARK)

_TEMPLATES = DefinitionTables(Template, TEMPLATE, {"photos": TEMPLATE_PHOTO})


def read(store: Store) -> tuple[StoredRecord[Template], ...]:
    """Return all templates in their order."""
    return _TEMPLATES.read(store)


def write(store: Store, stored: Iterable[StoredRecord[Template]]) -> None:
    """Replace all templates; template orientations stay, also those of templates that are no longer defined."""
    _TEMPLATES.write(store, stored)


def read_orientations(store: Store) -> dict[str, TemplateOrientation]:
    """Return the template orientations by the `record_key` of their template, sorted by name."""
    marks = store.lists(MARK)
    return {
        record_key(name): TemplateOrientation(name, kind, stage, measured_of(marks.get(record_key(name), [])))
        for name, kind, stage in store.rows(ORIENTATION)
    }


def write_orientations(store: Store, orientations: Iterable[TemplateOrientation]) -> None:
    """Replace all template orientations."""
    everything = tuple(orientations)
    refuse_case_twins(store, ORIENTATION.name, (item.template for item in everything))
    store.delete(ORIENTATION)
    store.insert(ORIENTATION, ((item.template, item.transformation, item.stage) for item in everything))
    for item in everything:
        store.insert(MARK, ((item.template, place, *row) for place, row in enumerate(measured_rows(item.marks))))
