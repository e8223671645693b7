"""Groups of commands that are registered when one of them is asked for: `orip --help` does not need them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import typer
from typer.main import get_group

from orip.cli.conversion import Group
from orip.cli.options import group_of_commands

Registration = Callable[[typer.Typer], None]


def add_group(app: typer.Typer, name: str, text: str, register: Registration) -> None:
    """Add a group of commands to a program or another group.

    Parameters
    ----------
    app : typer.Typer
    name : str
    text : str
        What `--help` says of the group.
    register : function of a typer.Typer
        Adds the commands of the group.
    """

    class LateGroup(Group):
        """The group of that name; commands that the program added to it are there from the beginning."""

        complete = False

        def list_commands(self, ctx: Any) -> list[str]:
            self._put_together()
            return super().list_commands(ctx)

        def get_command(self, ctx: Any, cmd_name: str) -> Any:
            self._put_together()
            return super().get_command(ctx, cmd_name)

        def _put_together(self) -> None:
            if not self.complete:
                group = group_of_commands(name, text)
                register(group)
                self.commands = {**get_group(group).commands, **self.commands}
                self.complete = True

    app.add_typer(group_of_commands(name, text, cls=LateGroup, no_args_is_help=True))
