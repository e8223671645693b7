"""`orip camera`, `temtick`, `photo`, `template`, `bundle` and `model`: the records of the stores."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Annotated

import typer

from orip.cli.completion import of_group
from orip.cli.conversion import require_confirmation
from orip.cli.options import (
    BundleOption,
    EditOptions,
    Invocation,
    YesOption,
    add_group,
    command,
    edit_document,
    tell_edit,
)
from orip.cli.terminal import Terminal
from orip.errors import UsageError

if TYPE_CHECKING:
    from orip.workflow.project.commit import Change
    from orip.workflow.project.state import ProjectState
    from orip.workflow.records.changes import RecordChange
    from orip.workflow.records.commands import RecordsOutcome
    from orip.workflow.records.document import RecordKind
    from orip.workflow.records.edits import RecordName


Name = Annotated[str, typer.Argument(metavar="NAME", autocompletion=of_group)]
DeletedName = Annotated[str | None, typer.Argument(metavar="NAME", autocompletion=of_group)]
AllModelsOption = Annotated[bool, typer.Option("--all", help="Delete all models of the bundle.")]
NewName = Annotated[str, typer.Argument(metavar="NEW_NAME")]
Values = Annotated[
    list[str] | None,
    typer.Argument(metavar="KEY=VALUE", help="Keys and values as in orip.toml; KEY= removes a value."),
]
BeforeOption = Annotated[
    str | None, typer.Option("--before", metavar="NAME", help="Insert before this record; else at the end.")
]
ReferentsOption = Annotated[
    bool, typer.Option("--with-referents", help="Delete all that refers to it as well, measurements included.")
]

_SHOWN_DELETIONS = 5
"""Most records that are named in the question whether to delete them."""

_ABOUT: dict[RecordKind, tuple[str, str]] = {
    "camera": ("Cameras: principal distance and point, distortion, fiducial marks.", "edit OLYMPUS c=8.6 unknown=C,A3"),
    "temtick": ("Tick marks of kinds of templates.", "edit GRID ticks.3='{x=10.0, y=220.0}'"),
    "photo": ("Photos: camera, template, preliminary orientation.", "add P101 camera=OLYMPUS template=T1"),
    "template": ("Templates: tick marks, stage plate, photos on them.", "edit T1 photos=P101,P103"),
    "bundle": ("Bundle adjustments: what controls them.", "edit MAIN measurement_precision=0.5px"),
    "model": ("Stereo models of a bundle.", "add M1 left=P101 right=P102 row=1 column=1"),
}


def register(app: typer.Typer) -> None:
    """Add a group of commands for each kind of record."""
    for kind, (about, example) in _ABOUT.items():
        add_group(app, kind, f"{about}\n\nExample: orip {kind} {example}", partial(_register, kind=kind))


def _left_out(kind: RecordKind) -> tuple[str, ...]:
    """Return the options that make no sense for a kind: only models belong to a bundle."""
    return () if kind == "model" else ("bundle",)


def _register(group: typer.Typer, kind: RecordKind) -> None:
    _register_reading(group, kind)
    _register_adding(group, kind)
    _register_changing(group, kind)


def _register_reading(group: typer.Typer, kind: RecordKind) -> None:
    @command(group, "list", reads_only=True, without=_left_out(kind))
    def list_command(invocation: Invocation, bundle: BundleOption = None) -> None:
        """List the records of the store, and where each came from."""
        from orip.workflow.project.state import read_project
        from orip.workflow.records.lists import list_records

        found = list_records(read_project(invocation.folder, "definitions"), kind, bundle)
        rows = [
            {**({"bundle": row.bundle} if row.bundle else {}), **row.table, "from": row.source} for row in found.rows
        ]
        invocation.terminal.warn(found.warnings)
        invocation.terminal.answer("records", {"command": f"{kind} list", "records": rows}, found.text)

    @command(group, "show", reads_only=True, without=_left_out(kind))
    def show_command(invocation: Invocation, name: Name, bundle: BundleOption = None) -> None:
        """Show all values of a record under the keys with which they are edited."""
        from orip.workflow.project.state import read_project
        from orip.workflow.records.lists import show_record

        found = show_record(read_project(invocation.folder, "definitions"), _record(kind, name, bundle))
        document = {
            "command": f"{kind} show",
            "record": found.row.table,
            "values": [value._asdict() for value in found.values],
            "from": found.row.source,
            "named_by": list(found.named_by),
        }
        invocation.terminal.answer("record", document, found.text)


def _register_adding(group: typer.Typer, kind: RecordKind) -> None:
    @command(group, "add", without=_left_out(kind))
    def add_command(
        invocation: Invocation,
        name: Name,
        options: EditOptions,
        values: Values = None,
        before: BeforeOption = None,
    ) -> None:
        """Add a record."""
        from orip.workflow.records.commands import add_record

        edit = partial(add_record, record=_record(kind, name, options.bundle), words=values or (), before=before)
        tell(invocation.terminal, f"{kind} add", _edited(invocation, edit, dry=options.dry_run))

    @command(group, "copy", without=_left_out(kind))
    def copy_command(
        invocation: Invocation,
        name: Name,
        new_name: NewName,
        options: EditOptions,
        values: Values = None,
    ) -> None:
        """Add a record with the values of another one, some of them changed."""
        from orip.workflow.records.commands import copy_record

        edit = partial(copy_record, record=_record(kind, name, options.bundle), name=new_name, words=values or ())
        tell(invocation.terminal, f"{kind} copy", _edited(invocation, edit, dry=options.dry_run))


def _register_changing(group: typer.Typer, kind: RecordKind) -> None:
    @command(group, "edit", without=_left_out(kind))
    def edit_command(invocation: Invocation, name: Name, options: EditOptions, values: Values = None) -> None:
        """Change values of a record; 'orip init' keeps them as long as its text in orip.toml does not change."""
        from orip.workflow.records.commands import edit_record

        edit = partial(edit_record, record=_record(kind, name, options.bundle), words=values or ())
        tell(invocation.terminal, f"{kind} edit", _edited(invocation, edit, dry=options.dry_run))

    @command(group, "rename", without=_left_out(kind))
    def rename_command(invocation: Invocation, name: Name, new_name: NewName, options: EditOptions) -> None:
        """Give a record another name, also in all records and measurements of the stores that name it."""
        from orip.workflow.records.commands import rename_record

        edit = partial(rename_record, record=_record(kind, name, options.bundle), name=new_name)
        outcome = _edited(invocation, edit, dry=options.dry_run, with_solutions=kind == "bundle")
        tell(invocation.terminal, f"{kind} rename", outcome)

    @command(group, "delete", without=(*_left_out(kind), *(() if kind == "model" else ("everything",))))
    def delete_command(
        invocation: Invocation,
        options: EditOptions,
        name: DeletedName = None,
        with_referents: ReferentsOption = False,
        everything: AllModelsOption = False,
        yes: YesOption = False,
    ) -> None:
        """Delete a record that nothing refers to, or with all that does."""
        from orip.workflow.records.commands import delete_models, delete_record, read_records

        if (name is None) != everything:
            ways = " or --all" if kind == "model" else ""
            message = f"name the {kind} to delete{ways}; 'orip {kind} list' shows them"
            raise UsageError(message)
        edit: Callable[[ProjectState], Change[RecordsOutcome]] = (
            partial(delete_models, bundle=options.bundle)
            if name is None
            else partial(delete_record, record=_record(kind, name, options.bundle), with_referents=with_referents)
        )
        if not options.dry_run:
            planned = edit(read_records(invocation.folder)).outcome  # errors are reported before the user is asked
            require_confirmation(f"Delete {_deleted_text(planned)}?", yes)
        tell(invocation.terminal, f"{kind} delete", _edited(invocation, edit, dry=options.dry_run))


def _deleted_text(outcome: RecordsOutcome) -> str:
    """Return what a deletion takes away, records first."""
    from orip.wording import first_names

    gone = [f"{change.kind} {change.name}" for change in outcome.changes if change.action == "deleted"]
    return first_names([*gone, *outcome.measurements], _SHOWN_DELETIONS)


def _record(kind: RecordKind, name: str, bundle: str | None) -> RecordName:
    from orip.workflow.records.edits import RecordName

    return RecordName(kind, name, bundle)


def _edited(
    invocation: Invocation,
    edit: Callable[[ProjectState], Change[RecordsOutcome]],
    *,
    dry: bool,
    with_solutions: bool = False,
) -> RecordsOutcome:
    from orip.workflow.project.commit import carry_out
    from orip.workflow.records.commands import dry_run, read_records

    state = read_records(invocation.folder, with_solutions=with_solutions)
    return dry_run(edit(state)).outcome if dry else carry_out(state, edit).outcome


def tell(terminal: Terminal, command_name: str, outcome: RecordsOutcome) -> None:
    """Print what was done to the records."""
    verb = f"{command_name.split()[1]:<8}"
    tell_edit(terminal, verb, outcome, "the records are")
    for change in outcome.changes:
        _tell_change(terminal, change)
    for measured in outcome.measurements:
        terminal.say(f"deleted  {measured}")
    if terminal.json:
        document = edit_document(command_name, outcome, measurements_deleted=list(outcome.measurements))
        terminal.document("record-edit", document)


def _tell_change(terminal: Terminal, change: RecordChange) -> None:
    from orip.workflow.records.changes import shown_value

    name = f"{change.old_name} -> {change.name}" if change.old_name else change.name
    terminal.say(f"{change.action:<8} {change.kind} {name}")
    for value in change.values:
        old = "" if change.action == "added" else f"{shown_value(value.old)} -> "
        terminal.say(f"         {value.key}  {old}{shown_value(value.new)} {value.unit}".rstrip())
