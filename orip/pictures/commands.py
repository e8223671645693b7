"""`orip photos`: a project from a folder of photographs."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NamedTuple

import typer

from orip.cli.options import Invocation, command
from orip.cli.terminal import Terminal
from orip.errors import UsageError
from orip.wording import counted

if TYPE_CHECKING:
    from orip.pictures.photo_project import PhotoProject


class PhotosOptions(NamedTuple):
    """Options of the project."""

    sensor_width: Annotated[
        float | None, typer.Option("--sensor-width", metavar="MM", help="Longer side of the sensor, for all cameras.")
    ] = None
    control: Annotated[
        Path | None, typer.Option("--control", metavar="FILE", help="Control points: .PNT; .csv, .txt: name X Y Z.")
    ] = None
    control_error: Annotated[
        float, typer.Option("--control-error", metavar="METRES", help="Of control points of a table without errors.")
    ] = 0.02
    crs: Annotated[
        str | None, typer.Option("--crs", metavar="CODE", help="Such as EPSG:25832; of control and results.")
    ] = None
    run: Annotated[bool, typer.Option("--run", help="Measure tie points and adjust: orip match and orip run.")] = False


def register(app: typer.Typer) -> None:
    """Add the command."""

    @command(app, "photos")
    def photos_command(
        invocation: Invocation,
        images: Annotated[Path, typer.Argument(metavar="DIR", help="Folder of the photographs.")],
        options: PhotosOptions,
        project: Annotated[
            Path | None, typer.Argument(metavar="PROJECT", help="Folder of the new project; default ./DIR_orip.")
        ] = None,
    ) -> None:
        """Make a project folder of a folder of photographs.

        Cameras, positions and times are those of EXIF and XMP. Images that are duplicates, blurred or damaged are named
        and left out; no image is changed or copied.

        Example: orip photos flight3 quarry --control gcp.csv --crs EPSG:25832
        """
        from orip.pictures.match import require_packages
        from orip.pictures.photo_project import PhotoSettings, make_photo_project

        for name, value in (("--sensor-width", options.sensor_width), ("--control-error", options.control_error)):
            if value is not None and not 1e-6 <= value <= 1000.0:
                message = f"{name} {value:g} is not possible; write a number above 0, up to 1000"
                raise UsageError(message)
        source = invocation.folder / images
        target = invocation.folder / (project if project is not None else f"{source.resolve().name}_orip")
        control = None if options.control is None else invocation.folder / options.control
        settings = PhotoSettings(options.sensor_width, control, options.control_error, options.crs)
        if options.run:
            require_packages()
        made = make_photo_project(source, target, settings)
        if not options.run:
            _tell(invocation.terminal, made)
            return
        if not invocation.terminal.json:
            _tell(invocation.terminal, made)
        raise typer.Exit(_adjusted(invocation.terminal, target))


def make_project(invocation: Invocation, images: Path, folder: Path, crs: str | None) -> None:
    """Make a project of a folder of photographs, and say what was made."""
    from orip.pictures.photo_project import PhotoSettings, make_photo_project

    settings = PhotoSettings(crs=crs)
    _tell(invocation.terminal, make_photo_project(invocation.folder / images, invocation.folder / folder, settings))


def _adjusted(terminal: Terminal, folder: Path) -> int:
    """Measure tie points in a new project and adjust it; return the exit code of the adjustment."""
    from orip.cli.run import run_project
    from orip.pictures.match import MatchRequest, match_photos
    from orip.pictures.match_command import foreteller, tell
    from orip.pictures.tie_points import TieSettings
    from orip.threads import limited_threads
    from orip.workflow.project.commit import commit
    from orip.workflow.records.commands import read_records

    state = read_records(folder)
    request = MatchRequest(state.project.bundle_name(None), None, TieSettings(), adjusts=True)
    with limited_threads(terminal.threads):
        outcome = commit(match_photos(state, request, foreteller(terminal))).outcome
    if not terminal.json:
        tell(terminal, outcome)
    return run_project(terminal, folder)


def _tell(terminal: Terminal, made: PhotoProject) -> None:
    from orip.pictures.photo_project import camera_words

    following = f"orip -C {shlex.quote(str(made.folder))} match"
    if terminal.json:
        terminal.document(
            "project-made",
            {
                "command": "photos",
                "project": made.name,
                "folder": str(made.folder),
                "files": list(made.files),
                "next": following,
            },
        )
        return
    survey = made.survey
    for camera in made.cameras:
        terminal.say(f"camera   {camera.name}: {counted(len(camera.photos), 'photo')}; {camera_words(camera.camera)}")
    for note in survey.notes:
        terminal.say(f"note     {note}")
    for path, fault in survey.left_out:
        terminal.say(f"left out {path.name}: {fault}")
    stations = f", {counted(made.stations, 'exposure station')}" if made.stations else ", no positions"
    control = f", {counted(made.control, 'control point')}" if made.control else ""
    terminal.say(f"wrote    {made.folder / 'orip.toml'}: {counted(len(survey.photos), 'photo')}{stations}{control}")
    terminal.say(f"next     {following}", "bold")
