"""`orip adjust`."""

from __future__ import annotations

from typing import Annotated

import typer

from orip.cli.exits import report
from orip.cli.options import Invocation, command
from orip.cli.project.run import run_project
from orip.errors import OripError, UsageError
from orip.exchange.commands import WORDS, SourceOptions, settings_of, split_words, tell_export, tell_import
from orip.structs import replace


def register(app: typer.Typer) -> None:
    """Add the command."""

    @command(app, "adjust")
    def adjust_command(
        invocation: Invocation, source: SourceOptions, words: Annotated[list[str] | None, WORDS] = None
    ) -> None:
        """Adjust a project of another program: import, run, report, and the result written back, in one command.

        The new folder appears when all of it is there; nothing is written into the original. If the result cannot be
        written back, the project is kept with its report, and the exit code is that of the refusal.

        Example: orip adjust castle/sparse/0 castle_adjusted
        """
        from orip.exchange.project.exported import EXPORTED_FROM, export, write_export
        from orip.exchange.project.imported import read_source, write_project
        from orip.exchange.project.temporary import folder_in_the_making
        from orip.exchange.project.texts import what_to_write
        from orip.workflow.project.bundle_state import read_bundle

        terminal = invocation.terminal
        name, given, folder = split_words(words or [], "adjust")
        imported = read_source(name, invocation.folder / given, settings_of(source, invocation.folder))
        if what_to_write(imported.block):
            message = f"{given} has no measurements, and nothing to adjust; 'orip import {given}' makes a project of it"
            raise UsageError(message)
        if imported.format.require_way_back is not None:
            imported.format.require_way_back(imported.block.project, imported.source)
        target = invocation.folder / (folder if folder is not None else f"{imported.title}_orip")
        refusal: OripError | None = None
        with folder_in_the_making(target) as temporary:
            write_project(imported, temporary)
            tell_import(terminal, imported, target, is_last=False)
            code = run_project(terminal, temporary)
            if imported.format.write is not None and imported.format.conventions is not None:
                try:
                    exported = export(read_bundle(temporary, None, *EXPORTED_FROM), imported.format.name, None)
                    write_export(exported)
                    tell_export(terminal, exported, is_last=False)
                except OripError as error:  # the adjustment is done, and is kept
                    refusal = error
        if refusal is not None:
            # stdout has the result already, and a second document would make both illegible
            code = report(replace(terminal, json=False), refusal)
            terminal.point(
                "wrote", f"{target}: the project with report.html and result.json; nothing was exported", "bold"
            )
            raise typer.Exit(code)
        terminal.point("wrote", f"{target}: the project with report.html, result.json and what was exported", "bold")
        raise typer.Exit(code)
