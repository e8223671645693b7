"""The records of the stores as a document of orip.toml, and back: edits of records are checked as their text would be.

Each rule and message of orip.toml thus holds for records that are edited by a command, and is stated once.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from typing import Any, TypeVar

from msgspec import Struct

from orip.errors import Complaint, InputError, ProjectWarning
from orip.files.project.reader import parse_project
from orip.files.project.record_values import TomlTable
from orip.files.project.text import project_document, project_text
from orip.files.stores.contents.definitions import NamedRecord, StoredRecord
from orip.records.names import record_key
from orip.records.project.camera import Camera
from orip.records.project.definition import ProjectDefinition
from orip.structs import replace
from orip.workflow.project.definitions import StoredDefinitions
from orip.workflow.project.folder import ProjectFolder
from orip.workflow.records.apply_text import with_polynomial

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
