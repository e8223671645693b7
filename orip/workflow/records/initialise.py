"""`orip init`: the records of orip.toml into the stores; and `orip export-toml`, the way back."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TypeVar

from msgspec import Struct

from orip.errors import Complaint, InputError, ProjectWarning, UsageError
from orip.files.project.merge import merged_project_text
from orip.files.project.records import project_document
from orip.files.stores.contents.definitions import NamedRecord, StoredRecord
from orip.files.text.atomic import reporting_failure
from orip.files.text.lines import decode_lines, read_bytes
from orip.files.text.regular_file import regular_bytes
from orip.interior.definitions import Definitions
from orip.interior.replay import replay_complaints
from orip.progress import stage
from orip.records.camera import without_radial_distortion
from orip.records.definition import ProjectDefinition
from orip.records.measurement import (
    EditRecord,
    FiducialsRecord,
    LogRecord,
    PhotoRecord,
    PointsRecord,
    TemplateRecord,
)
from orip.records.names import record_key
from orip.structs import replace
from orip.workflow.project.commit import Change
from orip.workflow.project.definitions import StoredDefinitions
from orip.workflow.project.folder import ProjectFolder
from orip.workflow.project.outputs import TextOutput, digest_of_text, require_replaceable
from orip.workflow.project.state import Part, ProjectState, StoredParts
from orip.workflow.project.texts import ProjectTexts, raise_complaints
from orip.workflow.records.changes import RecordChange, record_changes
from orip.workflow.records.document import checked, stored_definition, stored_document
from orip.workflow.records.reconcile import AppliedChange, Prefer, TextApplied, apply_text

INITIALISED_FROM: tuple[Part, ...] = ("definitions",)
"""What `initialise` needs of the stores."""


class Initialised(Struct, frozen=True):
    """What `orip init` did: the changes of records (none: nothing had changed), value by value, and warnings."""

    project: ProjectFolder
    changes: tuple[AppliedChange, ...]
    differences: tuple[RecordChange, ...]
    warnings: tuple[ProjectWarning, ...]


@stage("checking the texts")
def initialise(state: ProjectState, prefer: Prefer | None = None) -> Change[Initialised]:
    """Apply orip.toml to the stores; records whose text has not changed since it was last applied stay as they are.

    Parameters
    ----------
    state : ProjectState
        With `INITIALISED_FROM`.
    prefer : {"text", "store"} or None
        Which side wins where text and store have both changed a record.

    Raises
    ------
    InputError
        With everything that is wrong in any text file, or with all conflicts.
    """
    project, old = state.project, state.definitions
    texts, applied = state.texts.faults(), apply_text(project, old, prefer)
    log_complaints = _log_complaints(state.texts, applied, is_complete=not texts.complaints)
    raise_complaints([*texts.complaints, *log_complaints, *applied.complaints])
    differences = _differences(project, old, applied) if applied.changes else ()
    warnings = (*project.warnings, *texts.warnings)
    return Change(
        state,
        Initialised(project, applied.changes, differences, warnings),
        StoredParts(applied.definitions),
        project.record_stores,
        restores_outputs=True,
    )


def _differences(project: ProjectFolder, old: StoredDefinitions, applied: TextApplied) -> tuple[RecordChange, ...]:
    before, after = stored_document(project, old), stored_document(project, applied.definitions)
    return record_changes(before, after, None, project.definition.ground_unit)


def _log_complaints(texts: ProjectTexts, applied: TextApplied, *, is_complete: bool) -> Sequence[Complaint]:
    """Return what a replay of the measurements will complain of."""
    definitions, records = applied.definitions.by_name(), texts.log.value.records
    if applied.complaints or not is_complete:
        # lines that could not be read may be missing from the replay: only wrong names are certain
        records = tuple(_with_unknown_names(records, definitions))
    return replay_complaints(records, definitions)


def _with_unknown_names(records: Sequence[LogRecord], known: Definitions) -> Iterator[LogRecord]:
    for record in records:
        match record:
            case PointsRecord():
                unknown = record_key(record.bundle) not in known.bundles or record_key(record.photo) not in known.photos
            case PhotoRecord():
                unknown = record_key(record.photo) not in known.photos
            case TemplateRecord():
                unknown = record_key(record.template) not in known.templates
            case FiducialsRecord():
                unknown = record_key(record.camera) not in known.cameras
            case EditRecord():
                unknown = False  # an edit that finds nothing is a warning
            case _:
                unknown = record_key(record.temtick) not in known.temticks
        if unknown:
            yield record


T = TypeVar("T", bound=NamedRecord)

_REMEDY = "the file is unchanged"


class ExportedToml(Struct, frozen=True):
    """What `orip export-toml` did.

    Parameters
    ----------
    text : str
        The project file.
    path : Path or None
        Where it was written; None: nowhere.
    changed : bool
        Whether there was another text in the file.
    backup : Path or None
        Where the previous text is kept.
    """

    project: ProjectFolder
    text: str
    path: Path | None
    changed: bool
    backup: Path | None
    warnings: tuple[ProjectWarning, ...]


def export_toml(state: ProjectState, output: Path | None = None, *, force: bool = False) -> Change[ExportedToml]:
    """Bring the stores into the text: make a project file that says what they hold.

    Records that orip.toml already has as the stores hold them keep their lines, and others the comments above them.
    Cameras and temticks of other projects in shared stores are left out, unless a record of this project names them.

    Parameters
    ----------
    state : ProjectState
        With definitions.
    output : Path or None
        Where to, relative to the project folder; None: nothing is written.
    force : bool
        Also if the file has another text, which is then kept beside it with the extension .bak.

    Raises
    ------
    InputError
        If there are no stores, or their records are not fit for a project file.
    UsageError
        If there is another file of that name, without `force`.
    """
    project, stored = state.project, state.definitions
    if not any((stored.cameras, stored.temticks, stored.templates, stored.photos, stored.bundles)):
        message = "the project has no record stores yet; run 'orip init' first"
        raise InputError.single(message)
    definition = stored_definition(project, _own(project, stored))
    _require_fit(definition)
    text = merged_project_text(_text_of(project), _without_polynomial(definition))
    warnings = tuple(_not_applied(project, stored))
    if output is None:
        return Change(state, ExportedToml(project, text, None, changed=False, backup=None, warnings=warnings))
    path = project.folder / output
    there = _bytes_of(project, path)
    if there == text.encode():
        return Change(state, ExportedToml(project, text, path, changed=False, backup=None, warnings=warnings))
    if there is not None and not force:
        shown = project.shown(path)
        message = f"{shown} already exists with another text; write over it with --force (it is kept as .bak)"
        raise UsageError(message)
    if path != project.text:
        require_replaceable(project, path, force=force)
    backup = None if there is None else _free_name(path)
    outcome = ExportedToml(project, text, path, changed=True, backup=backup, warnings=warnings)
    output_text = TextOutput(path, lambda: [text], _REMEDY)
    return Change(state, outcome, kept=((path, backup),) if backup else (), outputs=(output_text,))


def _own(project: ProjectFolder, stored: StoredDefinitions) -> StoredDefinitions:
    """Return only the records of this project."""
    cameras = {record_key(photo.record.camera) for photo in stored.photos}
    temticks = {record_key(template.record.temtick) for template in stored.templates}

    def own(records: Sequence[StoredRecord[T]], named: set[str]) -> tuple[StoredRecord[T], ...]:
        home = {None, project.definition.name}
        return tuple(record for record in records if record.origin in home or record_key(record.record.name) in named)

    return replace(stored, cameras=own(stored.cameras, cameras), temticks=own(stored.temticks, temticks))


def _require_fit(definition: ProjectDefinition) -> None:
    try:
        checked(project_document(definition))
    except InputError as error:
        message = "the stores hold records that orip.toml may not have"
        raise InputError(
            [replace(complaint, message=f"{message}: {complaint.message}") for complaint in error.complaints]
        ) from None


def _without_polynomial(definition: ProjectDefinition) -> ProjectDefinition:
    """Return the definition as a text is read: the radial terms are 0 where the radial distortion has another form."""
    cameras = tuple(
        without_radial_distortion(camera)
        if camera.distortion_isp is not None or camera.distortion_curve is not None
        else camera
        for camera in definition.cameras
    )
    return replace(definition, cameras=cameras)


def _text_of(project: ProjectFolder) -> str:
    data, _ = read_bytes(project.text, project.shown(project.text))
    return "\n".join(decode_lines(data or b"", "").value)


def _not_applied(project: ProjectFolder, stored: StoredDefinitions) -> Iterator[ProjectWarning]:
    """Warn of differences between the text and the stores: the exported text has what is in the stores."""
    applied = apply_text(project, stored, prefer=None)
    done: Mapping[str, str] = {
        "added": "is in the text, but not in the stores: it is not exported",
        "changed": "has changed in the text, which was not applied: the store's version is exported",
        "removed": "was removed from the text, but still in the stores: it is exported",
        "detached": "was removed from the text, but still in the stores: it is exported",
    }
    shown = project.shown(project.text)
    for change in applied.changes:
        line = project.lines.get((change.kind, record_key(change.name)))
        where = shown if line is None else f"{shown}:{line}"
        yield ProjectWarning("not-applied", where, f"{change.kind} {change.name} {done[change.action]}")
    for complaint in applied.complaints:
        where = shown if complaint.line is None else f"{shown}:{complaint.line}"
        conflict = complaint.message.partition(":")[0].partition(";")[0]
        yield ProjectWarning("not-applied", where, f"{conflict}: the store's version is exported")


def _bytes_of(project: ProjectFolder, path: Path) -> bytes | None:
    """Return the content of a file; None if there is none."""
    with reporting_failure(project.shown(path), _REMEDY):
        return regular_bytes(path) if path.exists() else None


def _free_name(path: Path) -> Path:
    """Return a free name for a backup: FILE.bak, FILE.bak2, ...; that of one with the same content, if there is one."""
    names = (path.with_name(f"{path.name}.bak{number if number > 1 else ''}") for number in range(1, 10_000))
    digest = digest_of_text(path)
    return next(
        name
        for name in names
        if not (name.exists() or name.is_symlink()) or (not name.is_symlink() and digest_of_text(name) == digest)
    )
