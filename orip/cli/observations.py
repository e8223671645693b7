"""`orip observations` and `orip measure`."""

from __future__ import annotations

from collections.abc import Iterable
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer
from msgspec.structs import asdict

from orip.annexes import MEASURING_ONLINE, annex
from orip.cli.completion import photos, points
from orip.cli.conversion import require_confirmation
from orip.cli.corrections import register_corrections
from orip.cli.options import BundleOption, DryRunOption, EditOptions, Invocation, YesOption, command, group_of_commands
from orip.cli.terminal import Terminal, warning_rows
from orip.errors import UsageError

if TYPE_CHECKING:
    from orip.records.interior import ListedObservation, PointToMeasure, StereoPartner
    from orip.workflow.observations.edits import AddedEdits
    from orip.workflow.observations.listed import LeftAlone, ObservationList
    from orip.workflow.observations.measure import MeasureOutcome
    from orip.workflow.observations.todo import Todo
    from orip.workflow.project.commit import Change, Committed


def tell_list(terminal: Terminal, found: ObservationList, *, with_partners: bool, every: bool) -> None:
    """Print the tables of observations and partners."""
    from orip.files.listings.observations import observation_lines, partner_lines

    terminal.warn(found.warnings)
    lines = observation_lines(found.observations)
    if with_partners:
        lines += ["", *partner_lines(found.partners)]
    terminal.data("\n".join(lines))
    if not found.observations and not every:
        terminal.say("nothing of this is down-weighted; --all shows all that is measured")


def list_document(found: ObservationList) -> dict[str, Any]:
    """Return the list as a document for programs."""
    return {
        "command": "observations list",
        "bundle": found.bundle,
        "run": found.run,
        "observations": _rows(found.observations),
        "partners": _rows(found.partners),
        "warnings": warning_rows(found.warnings),
    }


def tell_edited(terminal: Terminal, verb: str, edited: AddedEdits) -> None:
    """Say what was added to EDITS.MEA, and which points have too few rays now."""
    terminal.warn(edited.warnings)
    if not edited.lines:
        behind = "; the stores were out of date and have been brought up to date" if edited.brought_up_to_date else ""
        terminal.say(f"edit     unchanged: the measurement files say so already{behind}")
    would = "trial    would add" if edited.is_trial else "added   "
    if verb == "remeasure" and edited.lines:
        terminal.say(f"{would} {len(edited.lines)} lines to EDITS.MEA")
    else:
        for line in edited.lines:
            terminal.say(f"{would} {line}")
    for observation in edited.left_alone:
        terminal.say(f"note     point {observation.point} {_left(observation)}", "yellow")
    if edited.lines and not edited.is_trial:
        terminal.say("next     orip solve")
    if terminal.json:
        terminal.document(
            "observation-edit",
            {
                "command": f"observations {verb}",
                "bundle": edited.bundle,
                "unchanged": not edited.lines and not edited.brought_up_to_date,
                "dry_run": edited.is_trial,
                "added": list(edited.lines),
                "left_alone": _rows(edited.left_alone),
                "warnings": warning_rows(edited.warnings),
            },
        )


def _left(alone: LeftAlone) -> str:
    if not alone.photos:
        return "is left with no ray"
    photo = alone.photos[0]
    kill = f"orip observations kill point {photo} {alone.point}"
    return f"is left with a single ray, in photo {photo}: kill it there too ({kill}), or measure it again"


def tell_todo(terminal: Terminal, todo: Todo) -> None:
    """Print the measurement file, or say where it was written."""
    terminal.warn(todo.warnings)
    if todo.file is None:
        terminal.data(todo.text)
    else:
        terminal.say(f"wrote    {todo.file}: {len(todo.points)} points to measure")


def todo_document(todo: Todo) -> dict[str, Any]:
    """Return what to measure as a document for programs."""
    return {
        "command": "observations todo",
        "bundle": todo.bundle,
        "file": None if todo.file is None else str(todo.file),
        "points": _rows(todo.points),
        "warnings": warning_rows(todo.warnings),
    }


def _rows(items: Iterable[ListedObservation | StereoPartner | PointToMeasure | LeftAlone]) -> list[dict[str, Any]]:
    return [{key: _plain(value) for key, value in asdict(item).items()} for item in items]


def _plain(value: Any) -> Any:
    """Return a value as JSON has it: None for a number that is NaN or infinite."""
    if isinstance(value, tuple):
        return [_plain(part) for part in value]
    return None if isinstance(value, float) and not isfinite(value) else value


Verb = Literal["disregard", "include", "kill"]
What = Annotated[Literal["point", "mark", "tick"], typer.Argument(metavar="point|mark|tick", show_default=False)]
Owner = Annotated[
    str,
    typer.Argument(metavar="PHOTO", autocompletion=photos, help="A photo (of a tick: template); '*' in quotes: all."),
]
Names = Annotated[
    list[str], typer.Argument(metavar="NAME", autocompletion=points, help="Points, marks or ticks; '*' in quotes: all.")
]

_ABOUT = """Photo observations: list, disregard, include, kill, measure again.

Example: orip observations disregard point P101 1001
"""
_DOES = {
    "disregard": "Keep points, marks or ticks with their residuals, but without weight.",
    "include": "Give disregarded points, marks or ticks their weight again.",
    "kill": "Delete measured points, marks or ticks; says which points are left with a single ray.",
}


def register(app: typer.Typer) -> None:
    """Add the group of commands."""
    _register_measure(app)
    group = group_of_commands("observations", _ABOUT, no_args_is_help=True)
    app.add_typer(group)
    _register_list(group)
    _register_edit(group, "disregard")
    _register_edit(group, "include")
    _register_kill(group)
    register_corrections(group, tell_edited)
    _register_again(group)


def _register_list(group: typer.Typer) -> None:
    @command(group, "list", reads_only=True)
    def list_command(
        invocation: Invocation,
        bundle: BundleOption = None,
        photo: Annotated[str | None, typer.Option("--photo", autocompletion=photos, help="Only that photo.")] = None,
        point: Annotated[str | None, typer.Option("--point", autocompletion=points, help="Only that point.")] = None,
        every: Annotated[bool, typer.Option("--all", help="All that is measured.")] = False,
        partners: Annotated[bool, typer.Option("--partners", help="Also the photos that show these points.")] = False,
    ) -> None:
        """Show down-weighted points with residuals, standard deviations and weight factors.

        Example: orip observations list --point 1001 --all --partners
        """
        from orip.workflow.observations.listed import LISTED_FROM, list_observations
        from orip.workflow.project.bundle_state import read_bundle

        given = read_bundle(invocation.folder, bundle, *LISTED_FROM)
        found = list_observations(given, photo, point, every=every, with_partners=partners)
        if invocation.terminal.json:
            invocation.terminal.document("observations", list_document(found))
        else:
            tell_list(invocation.terminal, found, with_partners=partners, every=every)


def _register_edit(group: typer.Typer, verb: Verb) -> None:
    def edit_command(invocation: Invocation, what: What, owner: Owner, names: Names, options: EditOptions) -> None:
        from orip.workflow.project.commit import commit

        change = _edited(invocation, verb, what, owner, names, options)
        tell_edited(invocation.terminal, verb, commit(change).outcome)

    edit_command.__doc__ = _documented(verb)
    command(group, verb)(edit_command)


def _register_kill(group: typer.Typer) -> None:
    def kill_command(
        invocation: Invocation,
        what: What,
        owner: Owner,
        names: Names,
        options: EditOptions,
        yes: YesOption = False,
    ) -> None:
        from orip.workflow.project.commit import commit

        change = _edited(invocation, "kill", what, owner, names, options)
        every = "every template" if what == "tick" else "every photo"
        chosen = f"all {what}s" if "*" in names else f"{what} {', '.join(names)}"
        if change.outcome.lines and not options.dry_run:
            require_confirmation(f"Kill {chosen} of {every if owner == '*' else owner}?", yes)
        tell_edited(invocation.terminal, "kill", commit(change).outcome)

    kill_command.__doc__ = _documented("kill")
    command(group, "kill")(kill_command)


def _documented(verb: Verb) -> str:
    return (
        f"{_DOES[verb]}\n\nIt goes into EDITS.MEA and counts whenever the measurements are replayed.\n\n"
        f"Example: orip observations {verb} point P101 1001 1002"
    )


def _edited(
    invocation: Invocation, verb: Verb, what: str, owner: str, names: list[str], options: EditOptions
) -> Change[AddedEdits]:
    from orip.workflow.observations.edits import EDITED_FROM, edit_observations
    from orip.workflow.project.state import read_project

    bundle, dry_run = options
    if bundle is not None and what != "point":
        message = f"a {what} belongs to no bundle; leave --bundle out"
        raise UsageError(message)
    state = read_project(invocation.folder, *EDITED_FROM)
    return edit_observations(state, _ACTIONS[verb], _WHAT[what], owner, names, bundle=bundle, is_trial=dry_run)


def _register_again(group: typer.Typer) -> None:
    @command(group, "todo")
    def todo_command(
        invocation: Invocation,
        bundle: BundleOption = None,
        output: Annotated[Path | None, typer.Option("--output", "-o", metavar="FILE", help="Write there.")] = None,
        force: Annotated[bool, typer.Option("--force", help="Replace a file that is there.")] = False,
        following: Annotated[
            bool, typer.Option("--next", help="List what is worth measuring next instead, as 'orip online' advises.")
        ] = False,
    ) -> None:
        """Write a .MEA file of what to measure again: down-weighted, disregarded and killed points, single rays.

        Example: orip observations todo --output again.txt
        """
        if following:
            if output is not None:
                message = "--next lists places in photos on the terminal; leave --output out"
                raise UsageError(message)
            annex(MEASURING_ONLINE).tell_next(invocation, bundle)
            return
        from orip.workflow.observations.listed import LISTED_FROM
        from orip.workflow.observations.todo import measure_again
        from orip.workflow.project.bundle_state import read_bundle
        from orip.workflow.project.commit import commit

        given = read_bundle(invocation.folder, bundle, *LISTED_FROM)
        todo = commit(measure_again(given, output, overwrite=force)).outcome
        if invocation.terminal.json:
            invocation.terminal.document("todo", todo_document(todo))
        else:
            tell_todo(invocation.terminal, todo)

    @command(group, "remeasure")
    def remeasure_command(
        invocation: Invocation,
        file: Annotated[Path, typer.Argument(metavar="FILE", help="A measurement file.")],
        dry_run: DryRunOption = False,
    ) -> None:
        """Append new measurements to EDITS.MEA: they replace those that were disregarded, killed or down-weighted.

        Example: orip observations remeasure again.txt
        """
        from orip.workflow.observations.edits import EDITED_FROM, remeasure
        from orip.workflow.project.commit import commit
        from orip.workflow.project.state import read_project

        change = remeasure(read_project(invocation.folder, *EDITED_FROM), file, is_trial=dry_run)
        tell_edited(invocation.terminal, "remeasure", commit(change).outcome)


_ACTIONS: dict[Verb, Literal["DISREGARD", "INCLUDE", "KILL"]] = {
    "disregard": "DISREGARD",
    "include": "INCLUDE",
    "kill": "KILL",
}
_WHAT: dict[str, Literal["POINT", "MARK", "TICK"]] = {"point": "POINT", "mark": "MARK", "tick": "TICK"}


Files = Annotated[
    list[Path] | None,
    typer.Argument(metavar="FILE", help="Read these on top of what the stores hold; none: replay the project's list."),
]


def _register_measure(app: typer.Typer) -> None:
    """Add the command."""

    @command(app, "measure")
    def measure_command(invocation: Invocation, files: Files = None) -> None:
        """Replay the measurement files into orientations and photo observations; write INTERIOR_RESULT.OUT.

        Example: orip measure
        """
        from orip.workflow.observations.measure import MEASURED_FROM, MEASURED_ON_TOP, measure, measure_on_top
        from orip.workflow.project.commit import commit
        from orip.workflow.project.state import read_project

        if files:
            state = read_project(invocation.folder, *MEASURED_ON_TOP)
            change = measure_on_top(state, [state.project.folder / path for path in files])
        else:
            change = measure(read_project(invocation.folder, *MEASURED_FROM))
        measured = commit(change)
        tell(invocation.terminal, measured)
        if invocation.terminal.json:
            outcome, counts = measured.outcome, measured.outcome.counts
            invocation.terminal.document(
                "measure",
                {
                    "command": "measure",
                    "unchanged": not measured.changed,
                    "files": [outcome.project.shown(path) for path in outcome.files],
                    "templates": counts.templates,
                    "photos": counts.photos,
                    "points": dict(counts.points),
                    "remeasured": counts.remeasured,
                    "warnings": warning_rows(outcome.warnings),
                },
            )


def tell(terminal: Terminal, measured: Committed[MeasureOutcome]) -> None:
    """Say how much is measured."""
    outcome = measured.outcome
    terminal.warn(outcome.warnings)
    counts = outcome.counts
    parts = [f"{count} photo points of {bundle}" for bundle, count in counts.points]
    if counts.templates or counts.photos:
        parts.insert(0, f"{counts.templates} templates and {counts.photos} photos oriented by marks")
    if counts.remeasured:
        parts.append(f"{counts.remeasured} measured again")
    unchanged = "" if measured.changed else "unchanged: "
    nothing = "nothing is measured yet"
    if not outcome.files:
        nothing += f": no file is called {' or '.join(outcome.project.definition.measurement_files)}"
    terminal.say(f"measure  {unchanged}{', '.join(parts) or nothing}")
    for path in outcome.files:
        terminal.detail(f"         read {outcome.project.shown(path)}")
