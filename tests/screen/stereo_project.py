"""A strip of rendered photos, adjusted, and its stereo screen served."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

from screen.rendered_project import serving
from support.rendered_surface import RenderedStrip, render_strip, write_strip
from workflow.quiet import run_quietly

from orip.annexes import STEREO_MODELS, annex
from orip.files.log.stereo import StereoFile
from orip.multimodel.stereo_processor import StereoProcessor
from orip.records.results.solution import Solution
from orip.screen.plates import plates_of
from orip.screen.stereo_screen import STEREO_FILE, StereoScreen
from orip.web.page_server import WatchServer
from orip.workflow.project.state import read_project


class Adjusted(NamedTuple):
    """The photos, the project's folder, and its adjustment."""

    strip: RenderedStrip
    folder: Path
    solution: Solution


def adjusted_strip(folder: Path) -> Adjusted:
    """Render a strip, write its project and adjust it."""
    strip = render_strip()
    write_strip(folder, strip)
    (done,) = run_quietly(folder)
    return Adjusted(strip, folder, done.solution)


def stereo_of(folder: Path) -> tuple[StereoProcessor, StereoScreen]:
    """Return the processor and the page's side of a project."""
    plates = plates_of(read_project(folder, "definitions"), None)
    extents = {name: (*plate.to_log((0.0, 0.0)), *plate.to_log(plate.size)) for name, plate in plates.items()}
    processor = annex(STEREO_MODELS).open_stereo(folder, None, extents)
    file = StereoFile(folder / STEREO_FILE, STEREO_FILE)
    return processor, StereoScreen(processor, "hills MAIN", "m", plates, folder, file)


@contextmanager
def served_stereo(folder: Path) -> Iterator[WatchServer]:
    """Serve the stereo screen of a project meanwhile."""
    _, screen = stereo_of(folder)
    with serving(screen) as server:
        yield server
