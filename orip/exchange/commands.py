"""`orip import`, `orip export` and `orip adjust`: foreign projects made folders of orip, and results written back."""

from __future__ import annotations

import os
import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NamedTuple

import typer

from orip.cli.completion import folder_of, that_begin
from orip.cli.exits import report
from orip.cli.options import BundleOption, ForceOption, Invocation, command
from orip.cli.run import run_project
from orip.cli.terminal import Terminal
from orip.errors import OripError, UsageError
from orip.structs import replace
from orip.wording import counted

if TYPE_CHECKING:
    from orip.exchange.project.block import ExchangeSettings
    from orip.exchange.project.exported import ExportedResult
    from orip.exchange.project.imported import ImportedProject


def _imported(context: typer.Context, incomplete: str) -> list[str]:
    """Return the formats that can be imported, and the files and folders that begin so; after a format these alone."""
    from orip.exchange.formats import FORMATS

    formats = [] if context.params.get("words") else [form.name for form in FORMATS if form.read is not None]
    folder = folder_of(context)
    above = incomplete[: incomplete.rfind("/") + 1]
    try:
        files = sorted(f"{above}{path.name}{'/' * path.is_dir()}" for path in (folder / above).iterdir())
    except OSError:
        files = []
    return that_begin((*formats, *files), incomplete)


def _formats_written(incomplete: str) -> list[str]:
    """Return the formats that can be exported."""
    from orip.exchange.formats import FORMATS

    return that_begin((form.name for form in FORMATS if form.write is not None), incomplete)


WORDS = typer.Argument(
    metavar="[FORMAT] SOURCE [DIR]",
    autocompletion=_imported,
    help="Format, its file or folder, and the new project's folder.",
)


class SourceOptions(NamedTuple):
    """Options of how a project of another program is read."""

    frame: Annotated[
        str | None, typer.Option("--frame", metavar="COLUMNSxROWS", help="Size of images, where no file says it.")
    ] = None
    exact_distortion: Annotated[
        bool, typer.Option("--exact-distortion", help="Accept any camera: measurements are corrected by its misfit.")
    ] = False
    hold_cameras: Annotated[bool, typer.Option("--hold-cameras", help="Do not adjust cameras.")] = False
    precision: Annotated[
        float | None, typer.Option("--precision", metavar="PIXELS", help="A-priori error of the measurements.")
    ] = None
    reference: Annotated[
        Path | None,
        typer.Option("--reference", metavar="TABLE", help="Metashape's references of cameras and markers."),
    ] = None
    reference_columns: Annotated[
        str | None,
        typer.Option("--reference-columns", metavar="LETTERS", help="Its columns, if it has no heading: nxyzXYZabc."),
    ] = None


def register(app: typer.Typer) -> None:
    """Add the commands."""
    _register_adjust(app)
    _register_import(app)
    _register_export(app)


def _register_import(app: typer.Typer) -> None:
    @command(app, "import")
    def import_command(
        invocation: Invocation,
        source: SourceOptions,
        words: Annotated[list[str] | None, WORDS] = None,
        list_formats: Annotated[bool, typer.Option("--list", help="List the formats that are read.")] = False,
    ) -> None:
        """Make a project folder of a project of another program.

        Before anything is written, points are projected with the imported photos: what does not fit is refused.

        Example: orip import colmap sparse/0 castle
        """
        from orip.exchange.project.imported import read_source, write_project

        if list_formats:
            tell_formats(invocation.terminal, is_read=True)
            return
        name, given, folder = split_words(words or [], "import")
        imported = read_source(name, invocation.folder / given, settings_of(source, invocation.folder))
        target = invocation.folder / (folder if folder is not None else f"{imported.title}_orip")
        write_project(imported, target)
        tell_import(invocation.terminal, imported, target)


def split_words(words: list[str], verb: str) -> tuple[str | None, Path, Path | None]:
    """Return the format (None: to be guessed), the source and the folder of a command line.

    Raises
    ------
    UsageError
        If there are too few or too many words.
    """
    from orip.exchange.formats import FORMATS, FORMATS_READ, format_named

    names = {one.name for one in FORMATS}
    is_named = len(words) > 1 and words[0].lower() in names
    name, rest = (words[0], words[1:]) if is_named else (None, words)
    if not 1 <= len(rest) <= 2:
        if len(words) > 2 and not is_named:
            format_named(words[0], FORMATS_READ)  # raises: it is none
        message = f"write 'orip {verb} SOURCE', or 'orip {verb} FORMAT SOURCE DIR'; 'orip import --list' shows formats"
        raise UsageError(message)
    return name, Path(rest[0]), Path(rest[1]) if len(rest) == 2 else None


def settings_of(options: SourceOptions, folder: Path) -> ExchangeSettings:
    """Return the settings that options stand for.

    Raises
    ------
    UsageError
        If a value is impossible.
    """
    from orip.exchange.metashape.references import require_letters
    from orip.exchange.project.block import ExchangeSettings
    from orip.exchange.project.imported import LARGEST_PRECISION, LEAST_PRECISION

    if options.precision is not None and not LEAST_PRECISION <= options.precision <= LARGEST_PRECISION:
        message = f"--precision {options.precision}: write pixels, {LEAST_PRECISION:g} to {LARGEST_PRECISION:.0f}"
        raise UsageError(message)
    letters = options.reference_columns or ""
    fault = require_letters(letters) if letters else None
    if fault is not None:
        message = f"--reference-columns {letters}: {fault}"
        raise UsageError(message)
    frame = None if options.frame is None else _frame(options.frame)
    table = None if options.reference is None else folder / options.reference
    return ExchangeSettings(frame, options.exact_distortion, options.hold_cameras, options.precision, table, letters)


def _frame(text: str) -> tuple[int, int]:
    columns, _, rows = text.lower().partition("x")
    if not (columns.isascii() and columns.isdigit() and rows.isascii() and rows.isdigit()) or len(text) > 15:
        message = f"--frame {text}: write columns and rows, such as 4000x3000"
        raise UsageError(message)
    return int(columns), int(rows)


def tell_formats(terminal: Terminal, *, is_read: bool) -> None:
    """Print the formats that are read, or those that are written, one a line."""
    from orip.exchange.formats import FORMATS

    shown = [one for one in FORMATS if (one.read if is_read else one.write) is not None]
    if terminal.json:
        rows = [{"name": one.name, "title": one.title} for one in shown]
        terminal.document("formats", {"command": "import" if is_read else "export", "formats": rows})
        return
    width = max(len(one.name) for one in shown)
    for one in shown:
        terminal.data(f"{one.name:{width}}  {one.title}")


def tell_import(terminal: Terminal, imported: ImportedProject, folder: Path, *, is_last: bool = True) -> None:
    """Print what was imported, how it fits and what is lost; where it was written if nothing else follows."""
    from orip.exchange.project.texts import summary_lines, what_to_write

    block = imported.block
    lines = summary_lines(block)
    terminal.point("import", f"{imported.format.name}: {lines[0]}")
    for line in lines[1:]:
        terminal.point("", line)
    for note in imported.content.notes:
        terminal.point("note", note)
    if not is_last:
        return
    terminal.point("wrote", f"{folder}: {', '.join(imported.file_names)}")
    quoted = shlex.quote(str(folder)) if os.name == "posix" else str(folder)
    first = what_to_write(block)
    terminal.point("next", (f"{first}; then: " if first else "") + f"orip -C {quoted} run", "bold")
    if terminal.json:
        has_residuals = block.found.lengths.size > 0
        stated = block.project.stated
        terminal.document(
            "import",
            {
                "command": "import",
                "format": imported.format.name,
                "folder": str(folder),
                "photos": len(block.photos),
                "points": len(block.points),
                "rays": len(block.pixels),
                "reprojection_rms": block.found.rms if has_residuals else None,
                "stated_error": None if stated is None else {"of": stated.of, "value": stated.value},
                "notes": list(imported.content.notes),
                "files": list(imported.file_names),
            },
        )


def _register_export(app: typer.Typer) -> None:
    @command(app, "export")
    def export_command(
        invocation: Invocation,
        format_name: Annotated[
            str | None,
            typer.Argument(
                metavar="FORMAT", autocompletion=_formats_written, help="Default: that of the imported project."
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
        from orip.exchange.project.exported import EXPORTED_FROM, export, write_export
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


def _register_adjust(app: typer.Typer) -> None:
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
        from orip.exchange.project.exported import EXPORTED_FROM, export, folder_in_the_making, write_export
        from orip.exchange.project.imported import read_source, write_project
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
