"""What `orip observations` prints."""

from __future__ import annotations

from collections.abc import Iterable
from math import isfinite
from typing import TYPE_CHECKING, Any

from msgspec.structs import asdict

from orip.cli.terminal import Terminal, warning_rows

if TYPE_CHECKING:
    from orip.records.results.interior import ListedObservation, PointToMeasure, StereoPartner
    from orip.workflow.observations.edits import AddedEdits
    from orip.workflow.observations.listed import LeftAlone, ObservationList
    from orip.workflow.observations.todo import Todo


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
