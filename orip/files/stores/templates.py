"""The store of templates (.TEM): definitions, and the tick marks that orient them on the stage plate."""

from __future__ import annotations

from collections.abc import Iterable
from typing import get_args

from orip.files.stores.definitions import Definitions, Parts, StoredRecord, definition_table, refuse_case_twins
from orip.files.stores.marks import TRANSFORMATION, measured_marks_table, measured_of, measured_rows
from orip.files.stores.scans import SCAN_CHECK, SCAN_COLUMNS, scan_of, scan_values
from orip.files.stores.store import Store
from orip.files.stores.table import Table, list_table, record_name, text
from orip.records.measurement import TemplateOrientation
from orip.records.names import record_key
from orip.records.photo import Stage, Template

STAGE = text("stage", get_args(Stage), optional=True)

TEMPLATE = definition_table("template", (record_name("temtick"), STAGE, *SCAN_COLUMNS), checks=(SCAN_CHECK,))
TEMPLATE_PHOTO = list_table("template_photo", "template", (record_name("photo"),), "photo")
# As with photos: what replaying the measurements left, whichever templates are defined now.
ORIENTATION = Table("template_orientation", (record_name("template"), TRANSFORMATION, STAGE), key=("template",))
MARK = measured_marks_table("template_mark", "template", parent="template_orientation")
TABLES = (TEMPLATE, TEMPLATE_PHOTO, ORIENTATION, MARK)


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


def _apart(template: Template) -> Parts:
    values = (template.temtick, template.stage, *scan_values(template.scan))
    return Parts(values, ([(photo,) for photo in template.photos],))


def _together(name: str, parts: Parts) -> Template:
    temtick, stage, *scan = parts.values
    photos = tuple(row[0] for row in parts.lists[0])
    return Template(name=name, temtick=temtick, stage=stage, photos=photos, scan=scan_of(*scan))


_TEMPLATES = Definitions(TEMPLATE, (TEMPLATE_PHOTO,), _apart, _together)
