"""`orip observations rename` and `edit`: single points corrected."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from orip.cli.completion import photos, points
from orip.cli.options import EditOptions, Invocation, command
from orip.cli.terminal import Terminal

if TYPE_CHECKING:
    from orip.workflow.observations.edits import AddedEdits

Tell = Callable[[Terminal, str, "AddedEdits"], None]
"""Says what was added to EDITS.MEA."""


def register_corrections(group: typer.Typer, tell: Tell) -> None:
    """Add the commands."""
    _register_rename(group, tell)
    _register_correct(group, tell)


def _register_rename(group: typer.Typer, tell: Tell) -> None:
    @command(group, "rename")
    def rename_command(
        invocation: Invocation,
        what: Annotated[Literal["point"], typer.Argument(metavar="point", show_default=False)],  # noqa: ARG001
        owner: Annotated[
            str, typer.Argument(metavar="PHOTO", autocompletion=photos, help="A photo; '*' in quotes: all.")
        ],
        name: Annotated[str, typer.Argument(metavar="NAME", autocompletion=points)],
        new_name: Annotated[str, typer.Argument(metavar="NEW_NAME")],
        options: EditOptions,
    ) -> None:
        """Give a point that was measured under a wrong name its right one.

        It goes into EDITS.MEA and counts whenever the measurements are replayed.

        Example: orip observations rename point P101 1001 1002
        """
        from orip.workflow.observations.edits import EDITED_FROM, rename_observation
        from orip.workflow.project.commit import commit
        from orip.workflow.project.state import read_project

        state = read_project(invocation.folder, *EDITED_FROM)
        bundle, dry_run = options
        change = rename_observation(state, owner, name, new_name, bundle=bundle, is_trial=dry_run)
        tell(invocation.terminal, "rename", commit(change).outcome)


def _register_correct(group: typer.Typer, tell: Tell) -> None:
    @command(group, "edit")
    def edit_command(
        invocation: Invocation,
        what: Annotated[Literal["point"], typer.Argument(metavar="point", show_default=False)],  # noqa: ARG001
        photo: Annotated[str, typer.Argument(metavar="PHOTO", autocompletion=photos)],
        name: Annotated[str, typer.Argument(metavar="NAME", autocompletion=points)],
        words: Annotated[list[str], typer.Argument(metavar="KEY=VALUE", help="x=... y=..., as in .MEA; name=...")],
        options: EditOptions,
    ) -> None:
        """Give a point in a photo other coordinates, or another name.

        It goes into EDITS.MEA as a correction, and counts whenever the measurements are replayed.

        Example: orip observations edit point P101 1001 x=35.2310 y=180.0040
        """
        from orip.workflow.observations.corrections import edit_point
        from orip.workflow.observations.edits import EDITED_FROM
        from orip.workflow.project.commit import commit
        from orip.workflow.project.state import read_project

        state = read_project(invocation.folder, *EDITED_FROM)
        bundle, dry_run = options
        change = edit_point(state, photo, name, words, bundle=bundle, is_trial=dry_run)
        tell(invocation.terminal, "edit", commit(change).outcome)
