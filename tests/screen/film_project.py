"""A project of one photo on scanned film whose marks are still to be measured."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from orip.workflow.project.commit import commit
from orip.workflow.project.state import read_project
from orip.workflow.records.initialise import initialise

PIXEL = 0.05
"""mm."""

FIDUCIALS = {"1": (-8.0, -8.0), "2": (8.0, -8.0), "3": (8.0, 8.0), "4": (-8.0, 8.0)}
_TICKS = {"A": (1.0, 1.0), "B": (19.0, 1.0), "C": (19.0, 19.0), "D": (1.0, 19.0)}


def pixel(xy: tuple[float, float]) -> tuple[float, float]:
    """Return where the scan shows a place of the photo: its film lies turned by a degree."""
    turn = np.radians(1.0)
    x, y = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]) @ xy
    return round(200.0 + float(x) / PIXEL, 4), round(200.0 - float(y) / PIXEL, 4)


def tick_pixel(name: str) -> tuple[float, float]:
    """Return where the scan shows a tick mark."""
    x, y = _TICKS[name]
    return x / PIXEL, 400.0 - y / PIXEL


def make_film(folder: Path, *, on_template: bool = False) -> Path:
    """Write the project, and apply it to its stores."""
    from PIL import Image

    grey = np.full((400, 400), 200, dtype=np.uint8)
    for place in FIDUCIALS.values():
        column, row = (round(value) for value in pixel(place))
        grey[row - 2 : row + 2, column - 2 : column + 2] = 20
    Image.fromarray(grey).save(folder / "F1.png")
    toml = f"""\
[project]
name = "film"

[[camera]]
name = "C"
c = 20.0
fiducials = [{_listed(FIDUCIALS)}]

[[photo]]
name = "F1"
camera = "C"
image = "F1.png"
{'template = "T1"' if on_template else f"scan = {{ pixel = {PIXEL} }}"}

[[bundle]]
name = "MAIN"
"""
    if on_template:
        toml += f"""
[[temtick]]
name = "GRID"
ticks = [{_listed(_TICKS)}]

[[template]]
name = "T1"
temtick = "GRID"
scan = {{ pixel = {PIXEL} }}
"""
    (folder / "orip.toml").write_text(toml, encoding="utf-8")
    commit(initialise(read_project(folder, "definitions")))
    return folder


def _listed(marks: dict[str, tuple[float, float]]) -> str:
    return ", ".join(f'{{ name = "{name}", x = {x}, y = {y} }}' for name, (x, y) in marks.items())
