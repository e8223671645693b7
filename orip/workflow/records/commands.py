"""`orip camera`, `temtick`, `photo`, `template`, `bundle` and `model`: records of the stores, edited one by one.

An edit is checked as a whole before anything is written: by the rules of orip.toml, with all records of the stores.
"""

from __future__ import annotations

import copy
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from orip.errors import InputError, LockedError, ProjectWarning
from orip.files.project.text import project_document
from orip.files.stores import exterior
from orip.files.stores.transaction import Stores, reading, writing
from orip.wording import first_names
from orip.workflow.project.definitions import StoredDefinitions, read_definitions, write_definitions
from orip.workflow.project.folder import Project, open_project
from orip.workflow.records import edits as record_edits
from orip.workflow.records.changes import RecordChange, Renaming, record_changes
from orip.workflow.records.document import CheckedDocument, bound, checked, stored_document
from orip.workflow.records.edits import Edit, Edited, RecordName
from orip.workflow.records.measurements import (
    delete_measurements,
    is_written,
    measurements_of,
    rename_measurements,
)
from orip.workflow.records.mentions import mention_warnings
from orip.workflow.records.renamed_bundle import (
    copy_preliminary,
    remove_files,
    remove_files_of_old_name,
    rename_solution,
    require_free_file,
)

_SHOWN_REFERENTS = 12


@dataclass(frozen=True, slots=True)
class RecordsOutcome:
    """What a command did to records, or would do (`dry_run`); no changes: the records were so already."""

    project: Project
    changes: tuple[RecordChange, ...]
    measurements: tuple[str, ...]
    warnings: tuple[ProjectWarning, ...]
    dry_run: bool


@dataclass(frozen=True, slots=True)
class _Plan:
    """An edit worked out against what the stores hold.

    `measurements` says what is measured of the records that go.
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
        return [each.record.name for each in self.before.bundles]


def add_record(
    folder: Path, record: RecordName, words: Sequence[str] = (), before: str | None = None, *, dry_run: bool = False
) -> RecordsOutcome:
    """Add a record with values given as KEY=VALUE, at the end or before another one.

    Raises
    ------
    InputError
        With everything that is wrong, or if there is another record of that name; nothing is written then.
    UsageError
        If a record that is named is not there.
    LockedError
    """
    return _change(folder, record_edits.adding(record, words, before), dry_run=dry_run)


def edit_record(folder: Path, record: RecordName, words: Sequence[str], *, dry_run: bool = False) -> RecordsOutcome:
    """Change values of a record; raises what `add_record` does."""
    return _change(folder, record_edits.editing(record, words), dry_run=dry_run)


def copy_record(
    folder: Path, record: RecordName, name: str, words: Sequence[str] = (), *, dry_run: bool = False
) -> RecordsOutcome:
    """Add a record with the values of another one, some of them changed; raises what `add_record` does."""
    return _change(folder, record_edits.copying(record, name, words), dry_run=dry_run)


def rename_record(folder: Path, record: RecordName, name: str, *, dry_run: bool = False) -> RecordsOutcome:
    """Give a record another name, in all records that name it and in what is measured; raises what `add_record` does.

    Text files keep the old name: a warning tells where. What is named after a bundle takes its new name.
    """
    return _change(folder, record_edits.renaming(record, name), dry_run=dry_run)


def delete_record(
    folder: Path, record: RecordName, *, with_referents: bool = False, dry_run: bool = False
) -> RecordsOutcome:
    """Delete a record, and with `with_referents` all that refers to it: records, and what is measured of them.

    Raises
    ------
    InputError
        If something refers to the record, without `with_referents`; it is all named.
    UsageError
        If there is no such record.
    LockedError
    """
    alone = None if with_referents else record
    return _change(folder, record_edits.deleting(record), alone=alone, dry_run=dry_run)


def _change(folder: Path, edit: Edit, *, dry_run: bool, alone: RecordName | None = None) -> RecordsOutcome:
    project = open_project(folder)
    with reading([project.exterior]) as stores:
        bundles = [each.record.name for each in exterior.read(stores[project.exterior])]
    paths = [*project.record_stores, *filter(is_written, map(project.observations, bundles))]
    with reading(paths) as stores:
        plan = _plan(project, stores, edit, alone)
    removed: tuple[ProjectWarning, ...] = ()
    if plan.changes and not dry_run:
        renamed = plan.renaming if plan.renaming is not None and plan.renaming.kind == "bundle" else None
        if renamed:
            require_free_file(project, renamed)
        new = [project.observations(renamed.new)] if renamed and is_written(project.observations(renamed.old)) else []
        with writing([*paths, *new]) as stores:
            plan = _plan(project, stores, edit, alone)  # another run may have changed them meanwhile
            if plan.bundles != bundles:
                message = (
                    "another run of orip has changed the bundles meanwhile; nothing was written, repeat the command"
                )
                raise LockedError(message)
            _write(project, stores, plan)
            if renamed:
                rename_solution(project, stores, renamed, plan.before, plan.after)
                copy_preliminary(project, renamed)
        deleted = [change.name for change in _deleted(plan.changes) if change.kind == "bundle"]
        remove_files([project.observations(name) for name in deleted])
        removed = remove_files_of_old_name(project, renamed) if renamed else ()
    warnings = (*plan.warnings, *mention_warnings(project, plan.before, plan.changes), *removed)
    return RecordsOutcome(project, plan.changes, plan.measurements, warnings, dry_run)


def _plan(project: Project, stores: Stores, edit: Edit, alone: RecordName | None) -> _Plan:
    stored = read_definitions(project, stores)
    _require_applied(project, stored)
    before = stored_document(project, stored)
    edited = edit(copy.deepcopy(before))
    found = _checked(edited)
    after = project_document(found.definition)
    ground_unit = project.definition.ground_unit
    changes = record_changes(before, after, edited.renaming, ground_unit)
    if changes and edited.known:
        raise InputError.single(edited.known)
    new = bound(found.definition, after, before, stored)
    bundles = [each.record.name for each in stored.bundles]
    measurements = tuple(_measurements(project, stores, bundles, changes))
    if alone is not None:
        _require_alone(alone, changes, measurements)
    known = _warnings_before(before) if found.warnings else frozenset()
    warnings = tuple(each for each in found.warnings if each not in known)
    return _Plan(stored, new, changes, edited.renaming, measurements, warnings)


def _checked(edited: Edited) -> CheckedDocument:
    try:
        return checked(edited.document, edited.faults)
    except InputError:
        if edited.known and not edited.faults:
            raise InputError.single(edited.known) from None
        raise


def _warnings_before(document: dict[str, Any]) -> frozenset[ProjectWarning]:
    with suppress(InputError):  # the edit has put right what was wrong
        return frozenset(checked(document).warnings)
    return frozenset()


def _require_applied(project: Project, stored: StoredDefinitions) -> None:
    text = project.definition
    in_text = (text.cameras, text.temticks, text.templates, text.photos, text.bundles)
    in_stores = (stored.cameras, stored.temticks, stored.templates, stored.photos, stored.bundles)
    if any(in_text) and not any(in_stores):
        message = "the project has no record stores yet; run 'orip init' first"
        raise InputError.single(message)


def _deleted(changes: Sequence[RecordChange]) -> Iterator[RecordChange]:
    return (change for change in changes if change.action == "deleted")


def _measurements(
    project: Project, stores: Stores, bundles: Sequence[str], changes: Sequence[RecordChange]
) -> Iterator[str]:
    for change in _deleted(changes):
        for what in measurements_of(project, stores, bundles, change.kind, change.name):
            yield f"{what} of {change.kind} {change.name}" if change.kind != "bundle" else f"{what} of {change.name}"


def _require_alone(record: RecordName, changes: Sequence[RecordChange], measurements: Sequence[str]) -> None:
    # models are parts of their bundle: they are deleted with it, not because they refer to it
    others = [
        f"{change.kind} {change.name}"
        for change in _deleted(changes)
        if change.kind != record.kind and not (record.kind == "bundle" and change.kind == "model")
    ]
    found = [*others, *measurements]
    if found:
        message = (
            f"{record.kind} {record.name} is referred to by {first_names(found, _SHOWN_REFERENTS)}; delete all of "
            f"them with --with-referents, or change them first"
        )
        raise InputError.single(message)


# writing


def _write(project: Project, stores: Stores, plan: _Plan) -> None:
    write_definitions(project, stores, plan.before, plan.after)
    if plan.renaming is not None:
        rename_measurements(project, stores, plan.bundles, plan.renaming)
    for kind in ("photo", "template", "bundle"):
        gone = [change.name for change in _deleted(plan.changes) if change.kind == kind]
        delete_measurements(project, stores, plan.bundles, kind, gone)
