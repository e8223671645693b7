"""`orip init`: the records of orip.toml into the stores."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from msgspec import Struct

from orip.errors import Complaint, ProjectWarning
from orip.interior.definitions import Definitions
from orip.interior.replay import replay_complaints
from orip.progress import stage
from orip.records.names import record_key
from orip.records.observations.measurement import (
    EditRecord,
    FiducialsRecord,
    LogRecord,
    PhotoRecord,
    PointsRecord,
    TemplateRecord,
)
from orip.workflow.project.commit import Change
from orip.workflow.project.definitions import StoredDefinitions
from orip.workflow.project.folder import ProjectFolder
from orip.workflow.project.state import Part, ProjectState, StoredParts
from orip.workflow.project.texts import ProjectTexts, raise_complaints
from orip.workflow.records.changes import RecordChange, record_changes
from orip.workflow.records.document import stored_document
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
