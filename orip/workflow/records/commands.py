"""`orip camera`, `temtick`, `photo`, `template`, `bundle` and `model`: records of the stores, edited one by one.

An edit is checked as a whole before anything is written: by the rules of orip.toml, with all records of the stores.
"""

from __future__ import annotations

import copy
from collections.abc import Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from msgspec import Struct

from orip.errors import InputError, ProjectWarning
from orip.files.project.records import project_document
from orip.files.stores.transaction import Stores
from orip.records.names import record_key
from orip.structs import replace
from orip.wording import first_names
from orip.workflow.project.commit import Change, ChangedMeanwhileError
from orip.workflow.project.definitions import StoredDefinitions
from orip.workflow.project.folder import ProjectFolder
from orip.workflow.project.state import Part, ProjectState, StoredParts, read_state
from orip.workflow.project.texts import open_checked_project
from orip.workflow.records import edits as record_edits
from orip.workflow.records.changes import RecordChange, Renaming, record_changes
from orip.workflow.records.document import CheckedDocument, bound, checked, stored_document
from orip.workflow.records.edits import Edit, EditedDocument, RecordName
from orip.workflow.records.mentions import (
    copy_preliminary,
    delete_measurements,
    files_of_old_name,
    is_written,
    measurements_of,
    mention_warnings,
    rename_measurements,
    rename_solution,
    require_free_file,
)

_SHOWN_REFERENTS = 12
_BUNDLES = "the bundles"


class RecordsOutcome(Struct, frozen=True):
    """What a command did to records, or would do (`dry_run`); no changes: the records have these values already."""

    project: ProjectFolder
    changes: tuple[RecordChange, ...]
    measurements: tuple[str, ...]
    warnings: tuple[ProjectWarning, ...]
    dry_run: bool


class _Plan(Struct, frozen=True):
    """An edit worked out against what the stores hold.

    `measurements` lists what is measured of the records that are deleted.
    """

    before: StoredDefinitions
    after: StoredDefinitions
    changes: tuple[RecordChange, ...]
    renaming: Renaming | None
    measurements: tuple[str, ...]
    warnings: tuple[ProjectWarning, ...]

    @property
    def bundles(self) -> list[str]:
        """Return the names of the bundles before the edit."""
        return [bundle.record.name for bundle in self.before.bundles]


def read_records(folder: Path, *, with_solutions: bool = False) -> ProjectState:
    """Read what the commands on records need: records, and what is measured of the bundles of the stores.

    Parameters
    ----------
    with_solutions : bool
        Also the solutions, which a bundle takes along when it gets another name.

    Raises
    ------
    InputError, LockedError
    """
    project = open_checked_project(folder)
    bundles = [stored.record.name for stored in read_state(project, {"definitions"}, ()).definitions.bundles]
    parts: tuple[Part, ...] = ("definitions", "marks", "observations")
    return read_state(project, (*parts, "solutions") if with_solutions else parts, bundles)


def add_record(
    state: ProjectState, record: RecordName, words: Sequence[str] = (), before: str | None = None
) -> Change[RecordsOutcome]:
    """Add a record with values given as KEY=VALUE, at the end or before another one.

    Parameters
    ----------
    state : ProjectState
        From `read_records`.

    Raises
    ------
    InputError
        With everything that is wrong, or if there is another record of that name.
    UsageError
        If a named record does not exist.
    """
    return _change(state, record_edits.adding(record, words, before))


def edit_record(state: ProjectState, record: RecordName, words: Sequence[str]) -> Change[RecordsOutcome]:
    """Change values of a record; raises what `add_record` does."""
    return _change(state, record_edits.editing(record, words))


def copy_record(
    state: ProjectState, record: RecordName, name: str, words: Sequence[str] = ()
) -> Change[RecordsOutcome]:
    """Add a record with the values of another one, some of them changed; raises what `add_record` does."""
    return _change(state, record_edits.copying(record, name, words))


def rename_record(state: ProjectState, record: RecordName, name: str) -> Change[RecordsOutcome]:
    """Give a record another name, in all records that name it and in what is measured; raises what `add_record` does.

    Text files keep the old name: a warning tells where. What is named after a bundle takes its new name; the state of
    such a command has the solutions. Where a killed run had renamed a bundle, what it has left is removed.
    """
    if _is_renamed_already(state, record, name):
        return Change(
            state, RecordsOutcome(state.project, (), (), (), dry_run=False), locks=state.project.record_stores
        )
    return _change(state, record_edits.renaming(record, name))


def _is_renamed_already(state: ProjectState, record: RecordName, name: str) -> bool:
    """Tell whether a bundle has its new name, and its store of the old name is still there."""
    stored = {record_key(bundle) for bundle in state.bundles}
    return (
        record.kind == "bundle"
        and record_key(record.name) not in stored
        and record_key(name) in stored
        and state.project.observations(record.name).is_file()
    )


def delete_record(state: ProjectState, record: RecordName, *, with_referents: bool = False) -> Change[RecordsOutcome]:
    """Delete a record, and with `with_referents` all that refers to it: records, and what is measured of them.

    Raises
    ------
    InputError
        If something refers to the record, without `with_referents`; all of it is named.
    UsageError
        If there is no such record.
    """
    return _change(state, record_edits.deleting(record), alone=None if with_referents else record)


def delete_models(state: ProjectState, bundle: str | None) -> Change[RecordsOutcome]:
    """Delete all models of a bundle, None: of the only one; raises what `delete_record` does."""
    return _change(state, record_edits.deleting_models(bundle))


def dry_run(change: Change[RecordsOutcome]) -> Change[RecordsOutcome]:
    """Return a change that writes nothing, and says so."""
    warnings = tuple(warning for warning in change.outcome.warnings if warning.code != "renamed-bundle")
    return Change(change.state, replace(change.outcome, warnings=warnings, dry_run=True))


def _change(state: ProjectState, edit: Edit, alone: RecordName | None = None) -> Change[RecordsOutcome]:
    plan, project = _plan(state, edit, alone), state.project
    if tuple(plan.bundles) != state.bundles:
        raise ChangedMeanwhileError(_BUNDLES)
    renamed = plan.renaming if plan.renaming is not None and plan.renaming.kind == "bundle" else None
    if renamed and plan.changes:
        require_free_file(project, renamed)
    superseded, removed = files_of_old_name(project, renamed) if renamed and plan.changes else ((), ())
    deleted = [change.name for change in _deleted(plan.changes) if change.kind == "bundle"]
    mentions = mention_warnings(state, plan.changes)
    outcome = RecordsOutcome(
        project, plan.changes, plan.measurements, (*plan.warnings, *mentions, *removed), dry_run=False
    )
    if not plan.changes:
        return Change(state, outcome)

    def further(stores: Stores) -> None:
        _write_measurements(project, stores, plan)
        if renamed:
            rename_solution(state, stores, renamed, plan.after)
            copy_preliminary(project, renamed)

    return Change(
        state,
        outcome,
        StoredParts(plan.after),
        _locks(state, renamed),
        further=further,
        superseded=(*map(project.observations, deleted), *superseded),
    )


def _locks(state: ProjectState, renamed: Renaming | None) -> tuple[Path, ...]:
    """Return the stores that are changed: those of records, and of photo observations that are there."""
    project = state.project
    names = [*state.bundles, *([renamed.new] if renamed and is_written(project.observations(renamed.old)) else [])]
    new = project.observations(renamed.new) if renamed else None
    paths = (path for path in map(project.observations, names) if path == new or is_written(path))
    return tuple(dict.fromkeys((*project.record_stores, *paths)))


def _plan(state: ProjectState, edit: Edit, alone: RecordName | None) -> _Plan:
    project, stored = state.project, state.definitions
    _require_applied(project, stored)
    before = stored_document(project, stored)
    edited = edit(copy.deepcopy(before))
    found = _checked(edited)
    after = project_document(found.definition)
    changes = record_changes(before, after, edited.renaming, project.definition.ground_unit)
    if changes and edited.known:
        raise InputError.single(edited.known)
    new = bound(found.definition, after, before, stored)
    measurements = tuple(_measurements(state, changes))
    if alone is not None:
        _require_alone(alone, changes, measurements)
    known = _warnings_before(before) if found.warnings else frozenset()
    warnings = tuple(warning for warning in found.warnings if warning not in known)
    return _Plan(stored, new, changes, edited.renaming, measurements, warnings)


def _checked(edited: EditedDocument) -> CheckedDocument:
    try:
        return checked(edited.document, edited.faults)
    except InputError:
        if edited.known and not edited.faults:
            raise InputError.single(edited.known) from None
        raise


def _warnings_before(document: dict[str, Any]) -> frozenset[ProjectWarning]:
    with suppress(InputError):  # the edit has corrected what was wrong
        return frozenset(checked(document).warnings)
    return frozenset()


def _require_applied(project: ProjectFolder, stored: StoredDefinitions) -> None:
    text = project.definition
    in_text = (text.cameras, text.temticks, text.templates, text.photos, text.bundles)
    in_stores = (stored.cameras, stored.temticks, stored.templates, stored.photos, stored.bundles)
    if any(in_text) and not any(in_stores):
        message = "the project has no record stores yet; run 'orip init' first"
        raise InputError.single(message)


def _deleted(changes: Sequence[RecordChange]) -> Iterator[RecordChange]:
    return (change for change in changes if change.action == "deleted")


def _measurements(state: ProjectState, changes: Sequence[RecordChange]) -> Iterator[str]:
    shared = state.records.sources_of_points
    for change in _deleted(changes):
        if change.kind == "bundle" and record_key(change.name) in shared:
            continue  # they stay in the bundle that they are measured for
        for what in measurements_of(state.measured, change.kind, change.name):
            yield f"{what} of {change.kind} {change.name}" if change.kind != "bundle" else f"{what} of {change.name}"


def _require_alone(record: RecordName, changes: Sequence[RecordChange], measurements: Sequence[str]) -> None:
    # models are parts of their bundle: they are deleted with it, not because they refer to it; of records of one kind
    # only cameras and bundles refer to each other
    others = [
        f"{change.kind} {change.name}"
        for change in _deleted(changes)
        if (
            change.kind != record.kind
            or (change.kind in ("camera", "bundle") and record_key(change.name) != record_key(record.name))
        )
        and not (record.kind == "bundle" and change.kind == "model")
    ]
    found = [*others, *measurements]
    if found:
        message = (
            f"{record.kind} {record.name} is referred to by {first_names(found, _SHOWN_REFERENTS)}; delete all of "
            f"them with --with-referents, or change them first"
        )
        raise InputError.single(message)


def _write_measurements(project: ProjectFolder, stores: Stores, plan: _Plan) -> None:
    if plan.renaming is not None:
        rename_measurements(project, stores, plan.bundles, plan.renaming)
    for kind in ("photo", "template", "bundle"):
        gone = [change.name for change in _deleted(plan.changes) if change.kind == kind]
        delete_measurements(project, stores, plan.bundles, kind, gone)
