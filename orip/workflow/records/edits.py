"""Edits of records in a document of orip.toml: add, edit, rename, copy, delete."""

from __future__ import annotations

import copy
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from msgspec import Struct

from orip.errors import InputError, UsageError
from orip.files.project.toml_text import TomlTable, with_assignments
from orip.files.text.shown import shown_token
from orip.records.camera import RADIAL_PARAMETERS
from orip.records.names import name_fault, record_key
from orip.structs import replace
from orip.wording import listed_names
from orip.workflow.records.changes import Renaming
from orip.workflow.records.document import (
    DocumentRecord,
    RecordKind,
    delete_with_referents,
    let_references_follow,
    photos_follow,
    records_of,
    templates_follow,
)


class EditedDocument(Struct, frozen=True):
    """A document after an edit.

    Parameters
    ----------
    known : str
        Not empty: the record already existed; what to say if the two differ.
    faults : tuple of str
        What was wrong with the values as given on the command line.
    """

    document: TomlTable
    renaming: Renaming | None = None
    known: str = ""
    faults: tuple[str, ...] = ()


Edit = Callable[[TomlTable], EditedDocument]
"""An edit: gets its own copy of a document, which it may change."""


class RecordName(Struct, frozen=True):
    """Which record is meant: its kind, its name, and for a model its bundle (None: the project's only one)."""

    kind: RecordKind
    name: str
    bundle: str | None = None


def adding(record: RecordName, words: Sequence[str], before: str | None) -> Edit:
    """Return the edit that adds a record, at the end or before another one."""

    def edit(document: TomlTable) -> EditedDocument:
        _require_fit_name(record.kind, record.name)
        table, faults = with_assignments(record.kind, {"name": record.name}, words)
        return replace(_put(document, record, table, before), faults=faults)

    return edit


def copying(record: RecordName, name: str, words: Sequence[str]) -> Edit:
    """Return the edit that adds a record with the values of another one, some of them changed."""

    def edit(document: TomlTable) -> EditedDocument:
        given = find(document, record).table
        table = copy.deepcopy(given) | {"name": name}
        _require_fit_name(record.kind, name)
        if record.kind == "template":
            table.pop("photos", None)  # a photo is on one template
        if record.kind == "bundle" and record_key(name) != record_key(given["name"]):
            table.setdefault("points_of", given["name"])
        table, faults = with_assignments(record.kind, table, words)
        return replace(_put(document, RecordName(record.kind, name, record.bundle), table, None), faults=faults)

    return edit


def editing(record: RecordName, words: Sequence[str]) -> Edit:
    """Return the edit that changes values of a record."""

    def edit(document: TomlTable) -> EditedDocument:
        place = find(document, record)
        table, faults = with_assignments(record.kind, place.table, words)
        if record.kind == "camera":
            _keep_one_radial_form(table, words)
        _replace(document, place, table)
        return EditedDocument(document, faults=faults)

    return edit


def renaming(record: RecordName, name: str) -> Edit:
    """Return the edit that gives a record another name, also wherever other records name it."""

    def edit(document: TomlTable) -> EditedDocument:
        place = find(document, record)
        _require_fit_name(record.kind, name)
        old = place.table["name"]
        if record_key(old) != record_key(name):
            _refuse_known(document, record, name)
        let_references_follow(document, record.kind, old, name)
        place.table["name"] = name
        return EditedDocument(document, Renaming(record.kind, old, name, place.bundle))

    return edit


def deleting(record: RecordName) -> Edit:
    """Return the edit that deletes a record and those that name it."""

    def edit(document: TomlTable) -> EditedDocument:
        delete_with_referents(document, find(document, record))
        return EditedDocument(document)

    return edit


def deleting_models(bundle: str | None) -> Edit:
    """Return the edit that deletes all models of a bundle; None: of the only one."""

    def edit(document: TomlTable) -> EditedDocument:
        bundle_of_models(document, bundle)["model"] = []
        return EditedDocument(document)

    return edit


def find(document: Mapping[str, Any], record: RecordName) -> DocumentRecord:
    """Return a record of a document.

    Raises
    ------
    UsageError
        If it is not there.
    """
    names = []
    bundle = bundle_of_models(document, record.bundle)["name"] if record.kind == "model" else ""
    for place in records_of(document, record.kind):
        if place.bundle == bundle:
            names.append(place.table["name"])
            if record_key(place.table["name"]) == record_key(record.name):
                return place
    message = f"there is no {record.kind} '{shown_token(record.name)}'; known are: {listed_names(names)}"
    raise UsageError(message)


def bundle_of_models(document: Mapping[str, Any], name: str | None) -> TomlTable:
    """Return the bundle that a command on models is about: the only one, or that of the name.

    Raises
    ------
    UsageError
    """
    bundles: list[TomlTable] = document["bundle"]
    if name is None and len(bundles) == 1:
        return bundles[0]
    names = listed_names(bundle["name"] for bundle in bundles)
    if name is None:
        message = f"the stores hold {len(bundles)} bundles; name that of the models with --bundle: {names}"
        raise UsageError(message)
    for bundle in bundles:
        if record_key(bundle["name"]) == record_key(name):
            return bundle
    message = f"there is no bundle '{shown_token(name)}'; known are: {names}"
    raise UsageError(message)


def _put(document: TomlTable, record: RecordName, table: TomlTable, before: str | None) -> EditedDocument:
    """Put a record into its list; an existing one of that name is replaced, for comparison."""
    bundle = bundle_of_models(document, record.bundle) if record.kind == "model" else None
    tables: list[TomlTable] = bundle.setdefault("model", []) if bundle is not None else document[record.kind]
    for known in tables:
        if record_key(known["name"]) == record_key(record.name):
            message = (
                f"{record.kind} {known['name']} already exists with other values; change it with "
                f"'orip {record.kind} edit', or choose another name"
            )
            kept = {key: known[key] for key in ("model",) if key in known and key not in table}
            place = DocumentRecord(record.kind, known, tables, bundle["name"] if bundle is not None else "")
            _replace(document, place, {**table, **kept})
            return EditedDocument(document, known=message)
    place = DocumentRecord(record.kind, table, tables)
    index = len(tables) if before is None else _index(document, RecordName(record.kind, before, record.bundle))
    tables.insert(index, table)
    _follow(document, place)
    return EditedDocument(document)


def _index(document: TomlTable, record: RecordName) -> int:
    place = find(document, record)
    return next(index for index, table in enumerate(place.around) if table is place.table)


def _keep_one_radial_form(camera: TomlTable, words: Sequence[str]) -> None:
    """Let the form of radial distortion that is assigned take the place of the one that the camera had."""
    assigned = {key.strip() for key, _, text in (word.partition("=") for word in words) if text.strip()}
    forms = {"distortion_isp", "distortion_curve"} & {key.partition(".")[0] for key in assigned}
    coefficients = {key.removeprefix("distortion.") for key in assigned} & set(RADIAL_PARAMETERS)
    if len(forms) + bool(coefficients) != 1:
        return  # none, or several: whoever checks the record says so
    for other in {"distortion_isp", "distortion_curve"} - forms:
        camera.pop(other, None)
    if forms and isinstance(camera.get("distortion"), dict):
        camera["distortion"] = {
            name: value for name, value in camera["distortion"].items() if name not in RADIAL_PARAMETERS
        }


def _replace(document: TomlTable, place: DocumentRecord, table: TomlTable) -> None:
    """Replace the values of a record; the lists of templates and the templates of photos stay consistent."""
    place.table.clear()
    place.table.update(table)
    _follow(document, place)


def _follow(document: TomlTable, place: DocumentRecord) -> None:
    if place.kind == "template":
        photos_follow(document, place.table)
    elif place.kind == "photo":
        templates_follow(document)


def _require_fit_name(kind: RecordKind, name: str) -> None:
    fault = name_fault(name)
    if fault is not None:
        message = f"{kind} name: {fault}; write one word"
        raise InputError.single(message)


def _refuse_known(document: TomlTable, record: RecordName, name: str) -> None:
    try:
        place = find(document, RecordName(record.kind, name, record.bundle))
    except UsageError:
        return
    message = f"{record.kind} {place.table['name']} already exists; choose another name, or delete it first"
    raise InputError.single(message)
