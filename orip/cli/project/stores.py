"""`orip dump` and `orip load`."""

from __future__ import annotations

import io
import sys
from pathlib import Path
from typing import Annotated

import typer

from orip.cli.options import Invocation, command

StoreArgument = Annotated[Path, typer.Argument(metavar="STORE", help="A .CAM .TIK .PHO .TEM .EXT or .EXO file.")]
TextArgument = Annotated[Path | None, typer.Argument(metavar="TEXT", help="A dump; none or '-': stdin.")]


def register(app: typer.Typer) -> None:
    """Add the commands."""

    @command(app, "dump", reads_only=True)
    def dump_command(invocation: Invocation, store: StoreArgument) -> None:
        """Print a record store as canonical text: equal data give equal text.

        Example: orip dump ZURICH.PHO > photos.txt
        """
        from orip.errors import InputError
        from orip.files.stores.dump import dump

        path = invocation.folder / store
        if not path.is_file():
            message = "there is no such store; 'orip init' and 'orip measure' make the stores of a project"
            raise InputError.single(message, str(store))
        for line in dump(path):
            invocation.terminal.data(line)

    @command(app, "load")
    def load_command(invocation: Invocation, store: StoreArgument, text: TextArgument = None) -> None:
        """Replace a record store's content by that of a dump, all or nothing.

        Example: orip load ZURICH.PHO photos.txt
        """
        from orip.errors import InputError
        from orip.files.stores.dump import load
        from orip.files.text.regular_file import open_regular

        if text is None or str(text) == "-":
            load(sys.stdin, invocation.folder / store, source="stdin")
        else:
            path = invocation.folder / text
            if not path.is_file():
                message = "there is no such file; name a text that 'orip dump' printed"
                raise InputError.single(message, str(text))
            with io.TextIOWrapper(open_regular(path), encoding="utf-8", errors="replace", newline="") as lines:
                load(lines, invocation.folder / store, source=str(text))
        invocation.terminal.say(f"load     {store} holds what the dump says")
