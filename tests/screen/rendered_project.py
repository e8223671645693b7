"""A project of three rendered photos of a plane, measured but for some of its control points."""

from __future__ import annotations

import json
import os
import sys
import threading
import urllib.error
import urllib.request
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from multiprocessing import get_context
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any

import numpy as np
from pictures.rendered_plane import RenderedPlane, project_text, render

from orip.annexes import MEASURING_ONLINE, annex
from orip.cli.main import main
from orip.screen.measuring_screen import MeasuringScreen
from orip.screen.plates import plates_of
from orip.screen.served_report import ServedReport
from orip.web.page_server import WatchServer
from orip.workflow.project.commit import commit
from orip.workflow.project.state import read_project
from orip.workflow.records.initialise import initialise

SIDE = 420
TOML = project_text(SIDE, "0.3px")
NEW = {"C7": (0.42, 0.61), "C8": (0.6, 0.45), "C9": (0.52, 0.38)}
"""Control that is not measured, in parts of the plane's side."""
_MEASURED = {f"C{number}": (0.35 + 0.15 * (number % 3), 0.35 + 0.3 * (number // 3)) for number in range(6)}
_TIES = {f"T{number}": (0.37 + 0.07 * (number % 5), 0.4 + 0.09 * (number // 5)) for number in range(15)}


class Rendered:
    """The photos, and where they show points."""

    def __init__(self) -> None:
        self.plane: RenderedPlane = render(3, SIDE, np.random.default_rng(11), noise=1.5)
        self.size = int(1.4 * SIDE)

    def pixel(self, photo: int, part: tuple[float, float]) -> tuple[float, float]:
        """Return where a photo shows a place."""
        x, y = self.plane.pixels(photo, np.array([part]) * self.size)[0].tolist()
        return x, y


def make_project(folder: Path, rendered: Rendered) -> Path:
    """Write the project, and apply it to its stores."""
    from PIL import Image

    (folder / "images").mkdir()
    toml, log = TOML, ""
    for photo, grey in enumerate(rendered.plane.photos):
        Image.fromarray(grey).save(folder / "images" / f"P{photo}.png")
        toml += f'\n[[photo]]\nname = "P{photo}"\ncamera = "C"\nimage = "images/P{photo}.png"\n'
        log += f"POINTS MAIN P{photo}\n"
        for name, part in {**_MEASURED, **_TIES}.items():
            x, y = rendered.pixel(photo, part)
            log += f"  {name} {x:.4f} {y:.4f}\n"
    control = {**_MEASURED, **NEW}
    # ground Y is upwards, rows of the texture are downwards
    lines = [
        f"{name} {u * rendered.size:.4f} {-v * rendered.size:.4f} 0.0 0.05 0.05 0.05\n"
        for name, (u, v) in control.items()
    ]
    (folder / "orip.toml").write_text(toml, encoding="utf-8")
    (folder / "plane.MEA").write_text(log, encoding="utf-8")
    (folder / "plane.PNT").write_text("".join(lines), encoding="utf-8")
    commit(initialise(read_project(folder, "definitions")))
    return folder


@contextmanager
def served(folder: Path) -> Iterator[WatchServer]:
    """Serve the screen of a project meanwhile."""
    state = read_project(folder, "definitions")
    session = annex(MEASURING_ONLINE).session_to_measure(folder, None)
    screen = MeasuringScreen(session, "plane MAIN", plates_of(state, None), folder)
    with serving(screen, report=ServedReport(folder, "MAIN")) as server:
        yield server


@contextmanager
def screen_of(folder: Path) -> Iterator[tuple[BaseProcess, str]]:
    """Run `orip screen` in a process of its own, which has loaded orip before; give it and the address of its page."""
    forks = get_context("forkserver")
    forks.set_forkserver_preload([__name__, "orip.screen.command"])
    receiver, sender = forks.Pipe(duplex=False)
    process = forks.Process(target=_screen, args=(str(folder), sender))
    process.start()
    sender.close()
    try:
        with open(receiver.fileno(), encoding="utf-8", closefd=False) as said:
            yield process, said.readline().strip()
    finally:
        process.kill()
        process.join()


def _screen(folder: str, said: Connection) -> None:
    sys.stdout = open(said.fileno(), "w", encoding="utf-8", closefd=False)  # noqa: SIM115  # while the process lasts
    sys.stderr = Path(os.devnull).open("w", encoding="utf-8")  # noqa: SIM115
    sys.argv = ["orip", "-C", folder, "screen", "--no-open"]
    main()


@contextmanager
def serving(screen: Any, **pages: Callable[[], str]) -> Iterator[WatchServer]:
    """Serve a page, its pictures and further pages meanwhile."""
    with WatchServer(screen, pictures=screen.picture, pages=pages) as server:
        thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.01})
        thread.start()
        try:
            yield server
        finally:
            server.shutdown()
            thread.join()


def asked(url: str, command: str, content: Any = None, **headers: str) -> tuple[int, Any]:
    """Return status and content of the reply to a request; without content it is a GET."""
    data = None if content is None else json.dumps(content).encode()
    request = urllib.request.Request(url + command, data, {"Content-Type": "application/json", **headers})
    try:
        with urllib.request.urlopen(request, timeout=30) as reply:
            status, body = reply.status, reply.read()
    except urllib.error.HTTPError as error:
        status, body = error.code, error.read()
    return status, json.loads(body) if body[:1] in (b"{", b"[") else body
