"""`orip screen`: measuring in the images of the photos."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from orip.annexes import MEASURING_ONLINE, STEREO_MODELS, annex
from orip.cli.options import BundleArgument, Invocation, command
from orip.errors import UsageError
from orip.threads import limited_threads
from orip.web import ANY_PORT

if TYPE_CHECKING:
    from orip.cli.terminal import Terminal
    from orip.screen.measuring_screen import MeasuringScreen
    from orip.screen.plates import Plate
    from orip.screen.stereo_screen import StereoScreen
    from orip.workflow.project.state import ProjectState

Images = Annotated[
    Path | None,
    typer.Option("--images", metavar="DIR", help="Images named as the photos (default: project folder)."),
]
Listen = Annotated[
    str,
    typer.Option(
        "--listen", metavar="HOST:PORT", help="Where the page is served, on this machine. Port 0: any that is free."
    ),
]
Stereo = Annotated[
    bool,
    typer.Option("--stereo", help="Measure points, lines and areas in the models of the last adjustment, in stereo."),
]
At = Annotated[
    str | None,
    typer.Option("--at", metavar="[PHOTO]/POINT", help="Shown first: a point in a photo, or where it is seen best."),
]
Open = Annotated[bool, typer.Option("--open/--no-open", help="Open the page in the browser.")]


def shown_first(at: str, plates: Mapping[str, Plate]) -> str:
    """Return what the address of the page has behind its ``#`` for a photo and point.

    Raises
    ------
    UsageError
        If there is no such photo.
    """
    from urllib.parse import urlencode

    from orip.records.names import record_key

    names = {record_key(name): name for name in plates}
    cuts = [place for place, letter in enumerate(at) if letter == "/"]
    for cut in cuts:  # names may have one, too
        photo, point = names.get(record_key(at[:cut]), ""), at[cut + 1 :]
        if point and (photo or not at[:cut]):
            return urlencode({"photo": photo, "point": point} if photo else {"point": point})
    message = f"'{at}' is no place: write a photo of the project and a point, such as {next(iter(plates))}/12, or /12"
    raise UsageError(message)


def _measuring_screen(
    _: Terminal, state: ProjectState, bundle: str | None, plates: Mapping[str, Plate]
) -> MeasuringScreen:
    from orip.screen.measuring_screen import MeasuringScreen

    project = state.project
    session = annex(MEASURING_ONLINE).session_to_measure(project.folder, bundle)
    title = f"{project.definition.name} {project.bundle_name(bundle)}"
    return MeasuringScreen(session, title, plates, project.folder)


def _stereo_screen(
    terminal: Terminal, state: ProjectState, bundle: str | None, plates: Mapping[str, Plate]
) -> StereoScreen:
    from orip.files.log.stereo import StereoFile
    from orip.screen.stereo_screen import STEREO_FILE, StereoScreen

    project = state.project
    extents = {
        plate.photo: (*plate.to_log((0.0, 0.0)), *plate.to_log(plate.size))
        for plate in plates.values()
        if not plate.fault
    }
    processor = annex(STEREO_MODELS).open_stereo(project.folder, bundle, extents)
    terminal.warn(processor.warnings)
    path = project.folder / STEREO_FILE
    title = f"{project.definition.name} {project.bundle_name(bundle)}"
    file = StereoFile(path, project.shown(path))
    return StereoScreen(processor, title, project.definition.ground_unit, plates, project.folder, file)


def register(app: typer.Typer) -> None:
    """Add the command."""

    @command(app, "screen")
    def screen_command(
        invocation: Invocation,
        bundle: BundleArgument = None,
        stereo: Stereo = False,
        images: Images = None,
        at: At = None,
        listen: Listen = ANY_PORT,
        browser: Open = True,
    ) -> None:
        """Measure in the images of the photos, in the browser: points, control, what does not fit.

        Every measurement is in EDITS.MEA before the page shows it, and is tested at once as by 'orip online'. The page
        can be seen only from this machine, and has the report of the last adjustment, in which every misfit, point and
        photo leads to its image; Ctrl-C ends it.

        With --stereo the two photos of a model lie side by side, or in one picture, under a floating mark; what is
        measured goes to STEREO.STE, for 'orip restitute compute'.

        Example: orip screen
        """
        from orip.screen.plates import plates_of
        from orip.screen.served_report import ServedReport
        from orip.web.access import listening_address, page_kept
        from orip.web.serving import page_server, serve_until_ended
        from orip.workflow.open_screen import only_screen
        from orip.workflow.project.state import read_project

        address = listening_address(listen, ", which is where the page can be seen")
        state = read_project(invocation.folder, "definitions")
        state.require_initialised()
        plates = plates_of(state, None if images is None else invocation.folder / images)
        shows = "" if at is None else shown_first(at, plates)
        with limited_threads(invocation.terminal.threads), only_screen(state.project.folder):
            begin = _stereo_screen if stereo else _measuring_screen
            screen = begin(invocation.terminal, state, bundle, plates)
            report = ServedReport(state.project.folder, state.project.bundle_name(bundle))
            with (
                page_server(screen, address, screen.picture, {"report": report}) as server,
                page_kept(state.project.folder, server.url),
            ):
                server.shows = shows
                for plate in plates.values():
                    if plate.fault:
                        invocation.terminal.say(f"photo {plate.photo}: {plate.fault}")
                invocation.terminal.answer("screen", {"command": "screen", "url": server.url}, server.url)
                invocation.terminal.flush()
                invocation.terminal.say("Ctrl-C ends it")
                serve_until_ended(server, browser=browser)
