"""`orip control`: the lines of .PNT, .ELE, .LEN, .DIR, .CON, .STA, .REL and .PRE files."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Annotated

import typer

from orip.cli.completion import lines_of_control
from orip.cli.conversion import require_confirmation
from orip.cli.options import (
    BundleOption,
    DryRunOption,
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
    from orip.files.control.editing import ControlKind
    from orip.workflow.observations.control import ControlOutcome, Weighting
    from orip.workflow.project.commit import Change
    from orip.workflow.project.state import ProjectState

Name = Annotated[
    str,
    typer.Argument(
        metavar="NAME",
        autocompletion=lines_of_control,
        help="Name, or the first fields that tell it from others: 'D1 1 2 XYZ'.",
    ),
]
NewName = Annotated[str, typer.Argument(metavar="NAME", help="Its first field.")]
Names = Annotated[list[str], typer.Argument(metavar="NAME", autocompletion=lines_of_control)]
SomeNames = Annotated[list[str] | None, typer.Argument(metavar="NAME", autocompletion=lines_of_control)]
Values = Annotated[
    list[str] | None, typer.Argument(metavar="KEY=VALUE", help="Keys as in the head of 'list'; KEY= removes it.")
]
BeforeOption = Annotated[
    str, typer.Option("--before", metavar="NAME", autocompletion=lines_of_control, help="Before this one.")
]
AllOption = Annotated[bool, typer.Option("--all", help="All lines of the file.")]

_ABOUT: dict[ControlKind, tuple[str, str]] = {
    "points": ("Control points (.PNT)", "add 5 X=1012.4 Y=2008.15 Z=101.2 aX=0.02 aY=0.02 aZ=0.03"),
    "elements": ("Observed values of unknowns (.ELE)", "add OLYMPUS group=CAMERA kind=C value=8.6 a=0.01"),
    "distances": ("Distances (.LEN)", "add D1 from=1 to=2 code=XYZ distance=12.345 a=0.005"),
    "directions": ("Theodolite directions (.DIR)", "add S1 station=7 target=1 direction=12.3456 a=0.001"),
    "figures": ("Points on lines, planes, cylinders, at equal heights (.CON)", "add WALL kind=PLANE point=7 a=0.005"),
    "stations": (
        "Exposure stations by GNSS and INS (.STA)",
        "add P101 X=1012.4 Y=2008.15 Z=401.2 aX=0.02 aY=0.02 aZ=0.04",
    ),
    "differences": (
        "Differences between exposure stations (.REL)",
        "add P101 second=P102 dX=41.32 dY=0.15 dZ=-0.08 aX=0.004 aY=0.004 aZ=0.005",
    ),
    "preliminary": ("Preliminary coordinates (BUNDLE.PRE)", "edit 1001 X=1012.4"),
}


def register(app: typer.Typer) -> None:
    """Add the group of commands."""
    about = "Ground control and preliminary coordinates, line by line; comments and order of the files stay."
    add_group(app, "control", f"{about}\n\nExample: orip control points list", _register_kinds)


def _register_kinds(control: typer.Typer) -> None:
    for kind, (title, example) in _ABOUT.items():
        text = f"{title}.\n\nExample: orip control {kind} {example}"
        add_group(control, kind, text, partial(_register, kind=kind))


def _left_out(kind: ControlKind) -> tuple[str, ...]:
    """Return the options that make no sense for a kind: only preliminary coordinates belong to a bundle."""
    return () if kind == "preliminary" else ("bundle",)


def _register(group: typer.Typer, kind: ControlKind) -> None:
    _register_list(group, kind)
    _register_adding(group, kind)
    _register_edit(group, kind)
    _register_kill(group, kind)
    if kind != "preliminary":
        _register_weighting(group, kind, "disregard", "Disregard: a-priori errors become negative.")
        _register_weighting(group, kind, "include", "Include again what was disregarded or rejected.")
    if kind == "points":
        _register_weighting(group, kind, "reject", "Reject: neither control nor check point.")


def _register_list(group: typer.Typer, kind: ControlKind) -> None:
    @command(group, "list", reads_only=True, without=_left_out(kind))
    def list_command(invocation: Invocation, bundle: BundleOption = None) -> None:
        """List the lines of the file."""
        from orip.files.text.table import Column, table_lines
        from orip.workflow.observations.control import list_control
        from orip.workflow.project.state import read_project

        table = list_control(read_project(invocation.folder), kind, bundle)
        if invocation.terminal.json:
            document = {"command": f"control {kind} list", "file": table.shown, "records": table.records()}
            invocation.terminal.document("control-list", document)
            return
        cells = [[*(text or "" for text in fields), "x" if off else ""] for _, fields, off in table.rows]
        headings = [*table.form.keys, ""]
        columns = [
            Column(heading, [row[index] for row in cells], align="left" if index < table.form.identity else "point")
            for index, heading in enumerate(headings)
        ]
        invocation.terminal.tables("\n".join(table_lines(columns)))


def _register_adding(group: typer.Typer, kind: ControlKind) -> None:
    def add(
        invocation: Invocation, name: str, values: list[str] | None, before: str | None, options: EditOptions
    ) -> None:
        from orip.workflow.observations.control import add_control

        edit = partial(add_control, kind=kind, name=name, words=values or (), before=before, **options._asdict())
        tell(invocation.terminal, f"control {kind} add", _edited(invocation, edit))

    @command(group, "add", without=_left_out(kind))
    def add_command(invocation: Invocation, name: NewName, options: EditOptions, values: Values = None) -> None:
        """Add a line at the end."""
        add(invocation, name, values, None, options)

    @command(group, "insert", without=_left_out(kind))
    def insert_command(
        invocation: Invocation,
        name: NewName,
        before: BeforeOption,
        options: EditOptions,
        values: Values = None,
    ) -> None:
        """Add a line before another one."""
        add(invocation, name, values, before, options)


def _register_edit(group: typer.Typer, kind: ControlKind) -> None:
    @command(group, "edit", without=_left_out(kind))
    def edit_command(invocation: Invocation, name: Name, options: EditOptions, values: Values = None) -> None:
        """Change values of a line; what is not named stays."""
        from orip.workflow.observations.control import edit_control

        edit = partial(edit_control, kind=kind, name=name, words=values or (), **options._asdict())
        tell(invocation.terminal, f"control {kind} edit", _edited(invocation, edit))


def _register_kill(group: typer.Typer, kind: ControlKind) -> None:
    @command(group, "kill", without=_left_out(kind))
    def kill_command(
        invocation: Invocation,
        options: EditOptions,
        names: SomeNames = None,
        everything: AllOption = False,
        yes: YesOption = False,
    ) -> None:
        """Take lines out. Comments on lines of their own stay."""
        from orip.workflow.observations.control import kill_control

        if bool(names) == everything:
            message = "name what to kill, or write --all and no name"
            raise UsageError(message)
        edit = partial(kill_control, kind=kind, names=names or (), **options._asdict())
        if not options.dry_run and _planned(invocation, edit).changes:
            what = f"all {kind}" if everything else f"{', '.join(names or ())} of {kind}"
            require_confirmation(f"Kill {what}?", yes)
        tell(invocation.terminal, f"control {kind} kill", _edited(invocation, edit))


def _register_weighting(group: typer.Typer, kind: ControlKind, weighting: Weighting, text: str) -> None:
    def weight(invocation: Invocation, names: Names, dry_run: DryRunOption = False) -> None:
        from orip.workflow.observations.control import weight_control

        edit = partial(weight_control, kind=kind, weighting=weighting, names=names, dry_run=dry_run)
        tell(invocation.terminal, f"control {kind} {weighting}", _edited(invocation, edit))

    weight.__doc__ = text
    command(group, weighting)(weight)


def _planned(invocation: Invocation, edit: Callable[[ProjectState], Change[ControlOutcome]]) -> ControlOutcome:
    """Return what an edit would do; errors are reported before the user is asked anything."""
    from orip.workflow.records.commands import read_records

    return edit(read_records(invocation.folder)).outcome


def _edited(invocation: Invocation, edit: Callable[[ProjectState], Change[ControlOutcome]]) -> ControlOutcome:
    from orip.workflow.project.commit import carry_out
    from orip.workflow.records.commands import read_records

    return carry_out(read_records(invocation.folder), edit).outcome


def tell(terminal: Terminal, command_name: str, outcome: ControlOutcome) -> None:
    """Print what was done to the lines."""
    verb = f"{command_name.split()[2]:<9}"
    tell_edit(terminal, verb, outcome, f"{outcome.shown} is")
    for change in outcome.changes:
        terminal.say(f"{change.action:<9} {outcome.shown}:{change.line}")
        for mark, line in (("-", change.old), ("+", change.new)):
            if line is not None:
                terminal.say(f"          {mark} {line}")
    if terminal.json:
        terminal.document("control-edit", edit_document(command_name, outcome, file=outcome.shown))
