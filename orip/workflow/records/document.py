"""The records of the stores as a document of orip.toml and back, and which of them name which others."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from typing import Any, Literal, TypeVar

from msgspec import Struct

from orip.errors import Complaint, InputError, ProjectWarning
from orip.files.project.reader import parse_project
from orip.files.project.records import project_document, project_text
from orip.files.project.toml_text import TomlTable
from orip.files.stores.contents.definitions import NamedRecord, StoredRecord
from orip.records.camera import Camera
from orip.records.definition import ProjectDefinition
from orip.records.names import record_key
from orip.structs import replace
from orip.workflow.project.definitions import StoredDefinitions
from orip.workflow.project.folder import ProjectFolder
from orip.workflow.records.reconcile import with_polynomial

# A model names its two photos, a photo its camera and its template, a template its tick marks, a camera with the lens
# of another one that camera. The list of photos of a template repeats what the photos say, and follows them.

RecordKind = Literal["camera", "temtick", "photo", "template", "bundle", "model"]

_REFERENCES: tuple[tuple[RecordKind, str, RecordKind], ...] = (
    ("photo", "camera", "camera"),
    ("camera", "same_lens_as", "camera"),
    ("template", "temtick", "temtick"),
    ("photo", "template", "template"),
    ("bundle", "points_of", "bundle"),
    ("model", "left", "photo"),
    ("model", "right", "photo"),
)
"""Kind of record, its key that names another one, and the kind of that one."""


class DocumentRecord(Struct, frozen=True):
    """A record in a document: its kind, its table, the list of tables that it is in, and the bundle of a model."""

    kind: RecordKind
    table: TomlTable
    around: list[TomlTable]
    bundle: str = ""

    @property
    def name(self) -> str:
        """Return the name of the record; that of a model with its bundle."""
        return f"{self.bundle} {self.table['name']}".strip()


def records_of(document: Mapping[str, Any], kind: RecordKind) -> Iterator[DocumentRecord]:
    """Iterate over the records of a kind."""
    if kind != "model":
        for table in document[kind]:
            yield DocumentRecord(kind, table, document[kind])
        return
    for bundle in document["bundle"]:
        for table in bundle.get("model", ()):
            yield DocumentRecord(kind, table, bundle["model"], bundle["name"])


def referents(document: Mapping[str, Any], kind: RecordKind, name: str) -> list[DocumentRecord]:
    """Return the records that name a record."""
    found: dict[int, DocumentRecord] = {}
    for where, key, what in _REFERENCES:
        if what == kind:
            named = (place for place in records_of(document, where) if _names(place.table, key, name))
            found |= {id(place.table): place for place in named}
    return list(found.values())


def let_references_follow(document: Mapping[str, Any], kind: RecordKind, old: str, new: str) -> None:
    """Replace the old name of a record wherever it occurs."""
    for where, key, what in _REFERENCES:
        if what == kind:
            for place in records_of(document, where):
                if _names(place.table, key, old):
                    place.table[key] = new
    if kind == "camera":
        for bundle in document["bundle"]:
            pairs = bundle.get("cameras", ())
            named = [[new if record_key(one) == record_key(old) else one for one in pair] for pair in pairs]
            bundle.update({"cameras": named} if named else {})
    if kind == "photo":
        for template in document["template"]:
            if "photos" in template:
                template["photos"] = [
                    new if record_key(photo) == record_key(old) else photo for photo in template["photos"]
                ]


def delete_with_referents(document: Mapping[str, Any], place: DocumentRecord) -> None:
    """Delete a record, after those that name it."""
    for referent in referents(document, place.kind, place.table["name"]):
        delete_with_referents(document, referent)
    place.around[:] = [table for table in place.around if table is not place.table]
    templates_follow(document)
    if place.kind == "camera":
        _leave_out_camera(document, place.table["name"])


def _leave_out_camera(document: Mapping[str, Any], name: str) -> None:
    """Let no bundle have a camera in place of another one that is gone, or for it."""
    for bundle in document["bundle"]:
        if "cameras" in bundle:
            bundle["cameras"] = [pair for pair in bundle["cameras"] if record_key(name) not in map(record_key, pair)]


def templates_follow(document: Mapping[str, Any]) -> None:
    """Let templates list the photos that name them, photos already listed first."""
    on: dict[str, dict[str, str]] = {}
    for photo in document["photo"]:
        if "template" in photo:
            on.setdefault(record_key(photo["template"]), {})[record_key(photo["name"])] = photo["name"]
    for template in document["template"]:
        there = on.get(record_key(template["name"]), {})
        kept = [there[record_key(photo)] for photo in template.get("photos", ()) if record_key(photo) in there]
        photos = list(dict.fromkeys([*kept, *there.values()]))
        if photos:
            template["photos"] = photos
        else:
            template.pop("photos", None)


def photos_follow(document: Mapping[str, Any], template: TomlTable) -> None:
    """Let photos name the template that lists them, and those that it no longer lists name none.

    A photo that is not there yet is made, with the camera of the photos beside it on the template, or the only camera;
    where there are several, whoever checks the document says that the camera is missing.
    """
    listed = {record_key(str(photo)) for photo in template.get("photos", ())}
    there = {record_key(photo["name"]) for photo in document["photo"]}
    cameras = _cameras_of(document, listed)
    for name in template.get("photos", ()):
        if isinstance(name, str) and record_key(name) not in there:
            document["photo"].append({"name": name, **({"camera": cameras[0]} if len(cameras) == 1 else {})})
    for photo in document["photo"]:
        here = record_key(str(photo.get("template", ""))) == record_key(template["name"])
        if record_key(photo["name"]) in listed:
            photo["template"] = photo["template"] if here else template["name"]
        elif here:
            del photo["template"]
    for other in document["template"]:
        if other is not template and "photos" in other:
            other["photos"] = [photo for photo in other["photos"] if record_key(photo) not in listed]


def _cameras_of(document: Mapping[str, Any], photos: set[str]) -> list[str]:
    """Return the cameras of some photos, each once and as it spells its name; where they have none, all cameras."""
    used = {
        record_key(photo["camera"])
        for photo in document["photo"]
        if record_key(photo["name"]) in photos and "camera" in photo
    }
    cameras = [camera["name"] for camera in document["camera"]]
    return [camera for camera in cameras if record_key(camera) in used] or cameras


def _names(table: TomlTable, key: str, name: str) -> bool:
    return record_key(str(table.get(key, ""))) == record_key(name)


# Each rule and message of orip.toml thus holds for records that are edited by a command, and is stated once.

T = TypeVar("T", bound=NamedRecord)

_LINE = re.compile(r" on line \d+")


class CheckedDocument(Struct, frozen=True):
    """The definition that a document gives, with distortions as polynomials, and warnings about it."""

    definition: ProjectDefinition
    warnings: tuple[ProjectWarning, ...]


def stored_definition(project: ProjectFolder, stored: StoredDefinitions) -> ProjectDefinition:
    """Return the project with the records of the stores in place of those of orip.toml."""
    return replace(
        project.definition,
        cameras=tuple(in_given_form(camera.record) for camera in stored.cameras),
        temticks=tuple(temtick.record for temtick in stored.temticks),
        templates=tuple(template.record for template in stored.templates),
        photos=tuple(photo.record for photo in stored.photos),
        bundles=tuple(bundle.record for bundle in stored.bundles),
    )


def in_given_form(camera: Camera) -> Camera:
    """Return the camera without the form in which its distortion was given, if the polynomial has changed since.

    Of a camera with such a form the radial terms are computed.
    """
    with suppress(InputError):  # a form that no text may have
        if with_polynomial(camera) == camera:
            return camera
    return replace(camera, distortion_isp=None, distortion_curve=None)


def stored_document(project: ProjectFolder, stored: StoredDefinitions) -> TomlTable:
    """Return the records of the stores as a document of orip.toml."""
    return project_document(stored_definition(project, stored))


def checked(document: Mapping[str, Any], faults: Sequence[str] = ()) -> CheckedDocument:
    """Check a document as orip.toml is checked; `faults` are what is known to be wrong already.

    Raises
    ------
    InputError
        With everything that is wrong. The user has not seen this text, so its line numbers are not given.
    """
    parsed = parse_project(project_text(document))
    complaints = [
        Complaint(fault) for fault in (*faults, *(_without_line(complaint.message) for complaint in parsed.complaints))
    ]
    if complaints or parsed.value is None:
        raise InputError(complaints)
    definition = parsed.value.definition
    definition = replace(definition, cameras=tuple(map(with_polynomial, definition.cameras)))
    warnings = tuple(replace(warning, where="", text=_without_line(warning.text)) for warning in parsed.warnings)
    return CheckedDocument(definition, warnings)


def bound(
    definition: ProjectDefinition, document: Mapping[str, Any], before: Mapping[str, Any], stored: StoredDefinitions
) -> StoredDefinitions:
    """Return the records of an edited document as the stores should hold them.

    A record whose table is unchanged stays what it is; an edited one stays bound to the text that it came from, so that
    `orip init` knows it as changed in the store. One of a new name has no text.
    """

    def of_kind(kind: str, records: Sequence[T], known: Iterable[StoredRecord[T]]) -> tuple[StoredRecord[T], ...]:
        by_key = {record_key(record.record.name): record for record in known}
        tables = {record_key(table["name"]): table for table in before[kind]}
        found = []
        for record, table in zip(records, document[kind], strict=True):
            key = record_key(record.name)
            old = by_key.get(key, StoredRecord(record))
            found.append(old if tables.get(key) == table else replace(old, record=record))
        return tuple(found)

    return StoredDefinitions(
        of_kind("camera", definition.cameras, stored.cameras),
        of_kind("temtick", definition.temticks, stored.temticks),
        of_kind("template", definition.templates, stored.templates),
        of_kind("photo", definition.photos, stored.photos),
        of_kind("bundle", definition.bundles, stored.bundles),
    )


def _without_line(message: str) -> str:
    return _LINE.sub("", message)
