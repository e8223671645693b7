"""`orip init`: the records of orip.toml into the stores."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from orip.errors import Complaint, ProjectWarning
from orip.files.stores.transaction import reading, writing
from orip.files.text.parsed import Parsed
from orip.interior.definitions import Definitions
from orip.interior.replay import replay
from orip.progress import stage
from orip.records.measurement import (
    EditRecord,
    FiducialsRecord,
    LogRecord,
    Measured,
    PhotoRecord,
    PointsRecord,
    TemplateRecord,
)
from orip.records.names import record_key
from orip.workflow.project.definitions import StoredDefinitions, read_definitions, write_definitions
from orip.workflow.project.folder import Project
from orip.workflow.project.outputs import rewrite_stale_outputs
from orip.workflow.project.texts import Texts, open_project_with_texts, raise_complaints
from orip.workflow.records.apply_text import TextApplied, apply_text
from orip.workflow.records.changes import RecordChange, record_changes
from orip.workflow.records.document import stored_document
from orip.workflow.records.reconcile import Change, Prefer


@dataclass(frozen=True, slots=True)
class Initialised:
    """What `orip init` did: the changes of records (none: nothing had changed), value by value, and what to know."""

    project: Project
    changes: tuple[Change, ...]
    differences: tuple[RecordChange, ...]
    warnings: tuple[ProjectWarning, ...]


def initialise(folder: Path, prefer: Prefer | None = None) -> Initialised:
    """Apply orip.toml to the stores; records that its text has not changed since stay as they are.

    Parameters
    ----------
    folder : Path
    prefer : {"text", "store"} or None
        Which side wins where text and store have both changed a record.

    Raises
    ------
    InputError
        With everything that is wrong in any text file, or with all conflicts; nothing is written then.
    LockedError
    """
    project, texts = open_project_with_texts(folder)
    return initialise_project(project, texts, prefer)


@stage("checking the texts")
def initialise_project(project: Project, texts: Parsed[Texts], prefer: Prefer | None) -> Initialised:
    """Do what `initialise` does with texts that have been read."""
    # All faults are found before a store is opened for writing, so that a refused project is left without new files.
    with reading(project.record_stores) as stores:
        applied = apply_text(project, read_definitions(project, stores), prefer)
    raise_complaints([*texts.complaints, *_log_complaints(texts, applied), *applied.complaints])
    with writing(project.record_stores) as stores:
        old = read_definitions(project, stores)
        applied = apply_text(project, old, prefer)  # another run may have changed them meanwhile
        raise_complaints(applied.complaints)
        write_definitions(project, stores, old, applied.definitions)
    rewrite_stale_outputs(project)
    differences = _differences(project, old, applied) if applied.changes else ()
    return Initialised(project, applied.changes, differences, (*project.warnings, *texts.warnings))


def _differences(project: Project, old: StoredDefinitions, applied: TextApplied) -> tuple[RecordChange, ...]:
    before, after = stored_document(project, old), stored_document(project, applied.definitions)
    return record_changes(before, after, None, project.definition.ground_unit)


def _log_complaints(texts: Parsed[Texts], applied: TextApplied) -> Sequence[Complaint]:
    """Return what a replay of the measurements will complain of."""
    definitions, records = applied.definitions.by_name(), texts.records.log.records
    if texts.complaints or applied.complaints:
        # lines that could not be read may be missing from the replay: wrong names alone are certain
        records = tuple(_with_unknown_names(records, definitions))
    return replay(records, definitions, Measured()).complaints


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
