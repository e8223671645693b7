"""Commands as the command line gives them: state read, change computed, change committed."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

from orip.multimodel.table_step import DRIVEN_FROM, DriveTableOutcome, make_drive_table
from orip.workflow.adjust import report as _report
from orip.workflow.adjust import undo_update as _undo_update
from orip.workflow.adjust import update as _update
from orip.workflow.adjust.report import WrittenReport
from orip.workflow.adjust.undo_update import UndoOutcome
from orip.workflow.adjust.update import UpdateOutcome, What
from orip.workflow.observations import control, edits, listed, todo
from orip.workflow.observations import measure as _measure
from orip.workflow.observations.control import ControlOutcome
from orip.workflow.observations.edits import EDITED_FROM, AddedEdits
from orip.workflow.observations.listed import LISTED_FROM, ObservationList
from orip.workflow.observations.measure import MEASURED_FROM, MEASURED_ON_TOP, MeasureOutcome
from orip.workflow.observations.todo import Todo
from orip.workflow.project.bundle_state import read_bundle
from orip.workflow.project.commit import Committed, carry_out, commit
from orip.workflow.project.state import read_project
from orip.workflow.records import commands as _records
from orip.workflow.records import initialise as _export_toml
from orip.workflow.records import initialise as _initialise
from orip.workflow.records import lists
from orip.workflow.records.commands import RecordsOutcome
from orip.workflow.records.document import RecordKind
from orip.workflow.records.edits import RecordName
from orip.workflow.records.initialise import INITIALISED_FROM, ExportedToml, Initialised
from orip.workflow.records.lists import RecordList
from orip.workflow.records.reconcile import Prefer
from orip.workflow.status import STATUS_FROM, ProjectStatus
from orip.workflow.status import project_status as status_of


def initialise(folder: Path, prefer: Prefer | None = None) -> Initialised:
    state = read_project(folder, *INITIALISED_FROM)
    return carry_out(state, partial(_initialise.initialise, prefer=prefer)).outcome


def measure(folder: Path, files: Sequence[Path] = ()) -> Committed[MeasureOutcome]:
    if not files:
        return commit(_measure.measure(read_project(folder, *MEASURED_FROM)))
    state = read_project(folder, *MEASURED_ON_TOP)
    return commit(_measure.measure_on_top(state, [folder / path for path in files]))


def project_status(folder: Path) -> ProjectStatus:
    return status_of(read_project(folder, *STATUS_FROM))


def update(folder: Path, what: What, names: Sequence[str] = ()) -> UpdateOutcome:
    bundle = read_bundle(folder, None, *_update.UPDATED_FROM)
    return carry_out(bundle, partial(_update.update, what=what, names=names)).outcome


def undo_update(folder: Path) -> UndoOutcome:
    return carry_out(read_project(folder, *_undo_update.UNDONE_FROM), _undo_update.undo_update).outcome


def report(folder: Path, bundle: str | None, output: Path | None) -> WrittenReport:
    return commit(_report.report(read_bundle(folder, bundle, *_report.REPORTED_FROM, "solutions"), output)).outcome


def edit_observations(folder: Path, *arguments: Any, **options: Any) -> AddedEdits:
    return commit(edits.edit_observations(read_project(folder, *EDITED_FROM), *arguments, **options)).outcome


def remeasure(folder: Path, file: Path, *, is_trial: bool = False) -> AddedEdits:
    return commit(edits.remeasure(read_project(folder, *EDITED_FROM), file, is_trial=is_trial)).outcome


def list_observations(folder: Path, bundle: str | None = None, *arguments: Any, **options: Any) -> ObservationList:
    return listed.list_observations(read_bundle(folder, bundle, *LISTED_FROM), *arguments, **options)


def measure_again(folder: Path, bundle: str | None = None, *arguments: Any, **options: Any) -> Todo:
    return commit(todo.measure_again(read_bundle(folder, bundle, *LISTED_FROM), *arguments, **options)).outcome


def write_drive_table(folder: Path, bundle: str | None) -> DriveTableOutcome:
    return commit(make_drive_table(read_bundle(folder, bundle, *DRIVEN_FROM))).outcome


def _edited(folder: Path, edit: Any, *arguments: Any, dry_run: bool = False, **options: Any) -> RecordsOutcome:
    state = _records.read_records(folder, with_solutions=edit is _records.rename_record)
    if dry_run:
        return _records.dry_run(edit(state, *arguments, **options)).outcome
    return carry_out(state, lambda now: edit(now, *arguments, **options)).outcome


def add_record(folder: Path, record: RecordName, *arguments: Any, **options: Any) -> RecordsOutcome:
    return _edited(folder, _records.add_record, record, *arguments, **options)


def copy_record(folder: Path, record: RecordName, *arguments: Any, **options: Any) -> RecordsOutcome:
    return _edited(folder, _records.copy_record, record, *arguments, **options)


def edit_record(folder: Path, record: RecordName, *arguments: Any, **options: Any) -> RecordsOutcome:
    return _edited(folder, _records.edit_record, record, *arguments, **options)


def rename_record(folder: Path, record: RecordName, *arguments: Any, **options: Any) -> RecordsOutcome:
    return _edited(folder, _records.rename_record, record, *arguments, **options)


def delete_record(folder: Path, record: RecordName, *arguments: Any, **options: Any) -> RecordsOutcome:
    return _edited(folder, _records.delete_record, record, *arguments, **options)


def list_records(folder: Path, kind: RecordKind) -> RecordList:
    return lists.list_records(read_project(folder, "definitions"), kind)


def export_toml(folder: Path, output: Path | None = None, *, force: bool = False) -> ExportedToml:
    return commit(_export_toml.export_toml(read_project(folder, "definitions"), output, force=force)).outcome


def edit_control(folder: Path, *arguments: Any) -> ControlOutcome:
    return carry_out(_records.read_records(folder), lambda state: control.edit_control(state, *arguments)).outcome
