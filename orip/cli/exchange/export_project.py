"""`orip export`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from orip.cli.completion import formats_written
from orip.cli.exchange.import_project import tell_formats
from orip.cli.options import BundleOption, ForceOption, Invocation, command
from orip.cli.terminal import Terminal
from orip.wording import counted

if TYPE_CHECKING:
    from orip.workflow.exchange.exported import ExportedResult


def register(app: typer.Typer) -> None:
    """Add the command."""

    @command(app, "export")
    def export_command(
        invocation: Invocation,
        format_name: Annotated[
            str | None,
            typer.Argument(
                metavar="FORMAT", autocompletion=formats_written, help="Default: that of the imported project."
            ),
        ] = None,
        target: Annotated[Path | None, typer.Argument(metavar="DEST", help="New folder, or file.")] = None,
        bundle: BundleOption = None,
        original: Annotated[
            Path | None, typer.Option("--original", metavar="PATH", help="Write the result into a copy of this one.")
        ] = None,
        exact_distortion: Annotated[
            bool, typer.Option("--exact-distortion", help="Correct measurements for what the format's cameras lack.")
        ] = False,
        force: ForceOption = False,
        list_formats: Annotated[bool, typer.Option("--list", help="List the formats that are written.")] = False,
    ) -> None:
        """Write the result of the last adjustment in the format of another program.

        A project that was imported goes into a copy of its original, where the format keeps numbers of photos and
        points: what the adjustment has not changed stays as it was.

        Example: orip export colmap adjusted
        """
        from orip.workflow.exchange.exported import EXPORTED_FROM, export, write_export
        from orip.workflow.project.bundle_state import read_bundle

        if list_formats:
            tell_formats(invocation.terminal, is_read=False)
            return
        folder = invocation.folder
        state = read_bundle(folder, bundle, *EXPORTED_FROM)
        given = None if target is None else folder / target
        source = None if original is None else folder / original
        exported = export(state, format_name, given, source, corrects_distortion=exact_distortion)
        write_export(exported, force=force)
        tell_export(invocation.terminal, exported)


def tell_export(terminal: Terminal, exported: ExportedResult, *, is_last: bool = True) -> None:
    """Print what was written, and what is lost; where it was written if nothing else follows."""
    project = exported.project
    counts = f"{counted(len(project.photos), 'photo')}, {counted(len(project.points.names), 'point')}"
    copied = "" if exported.original is None else f", in a copy of {exported.original}"
    terminal.point("export", f"{exported.format.name}: {counts}{copied}")
    for note in exported.notes:
        terminal.point("note", note)
    if not is_last:
        return
    names = "" if exported.format.is_file else f": {', '.join(exported.files)}"
    terminal.point("wrote", f"{exported.target}{names}")
    if terminal.json:
        terminal.document(
            "export",
            {
                "command": "export",
                "format": exported.format.name,
                "target": str(exported.target),
                "original": None if exported.original is None else str(exported.original),
                "photos": len(project.photos),
                "points": len(project.points.names),
                "notes": list(exported.notes),
                "files": list(exported.files),
            },
        )
