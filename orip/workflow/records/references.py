"""Which records name which others, and how references follow when records change.

A model names its two photos, a photo its camera and its template, a template its tick marks, a camera with the lens of
another one that camera. The list of photos of a template repeats what the photos say, and follows them.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, Literal

from msgspec import Struct

from orip.files.project.record_values import TomlTable
from orip.records.names import record_key

RecordKind = Literal["camera", "temtick", "photo", "template", "bundle", "model"]

_REFERENCES: tuple[tuple[RecordKind, str, RecordKind], ...] = (
    ("photo", "camera", "camera"),
    ("camera", "same_lens_as", "camera"),
    ("template", "temtick", "temtick"),
    ("photo", "template", "template"),
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
