"""A project on film: two photos on one template, measured with errors, its film mounted as one likes."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
from interior.films import lines, on_plate, placed
from workflow.small_projects import film_project

from orip.geometry.plane import PlaneTransformation

TICKS = {"1": (0.0, 0.0), "2": (200.0, 0.0), "3": (200.0, 200.0), "4": (0.0, 200.0), "5": (100.0, 0.0)}
MARKS = {"1": (-18.0, -12.0), "2": (18.0, -12.0), "3": (18.0, 12.0), "4": (-18.0, 12.0)}
PHOTOS = {"left": "P1", "right": "P2"}
"""Photos of the project, and those of `films.ON_TEMPLATE` whose places they have."""


def template_project(folder: Path) -> Path:
    """Write the film project with its photos on template T1, without measurements."""
    film_project(folder)
    toml = (folder / "orip.toml").read_text(encoding="utf-8")
    ticks = ", ".join(f'{{ name = "{name}", x = {x}, y = {y} }}' for name, (x, y) in TICKS.items())
    tables = f'[[temtick]]\nname = "TT"\nticks = [{ticks}]\n[[template]]\nname = "T1"\ntemtick = "TT"\n'
    toml += tables + 'photos = ["left", "right"]\n'
    (folder / "orip.toml").write_text(toml, encoding="utf-8")
    return folder


def photo_points(folder: Path) -> dict[str, dict[str, tuple[float, float]]]:
    """Return the photo coordinates (mm) that the film project measures off a template."""
    found: dict[str, dict[str, tuple[float, float]]] = {}
    block: dict[str, tuple[float, float]] = {}
    for line in (folder / "FIRST.MEA").read_text(encoding="utf-8").splitlines():
        if match := re.match(r"(POINTS MAIN|PHOTO) (\w+)", line):
            block = found.setdefault(match[2], {}) if match[1].startswith("POINTS") else {}
        else:
            name, x, y = line.split()
            block[name] = float(x) - 100.0, float(y) - 100.0
    return found


def film_with_blunder(folder: Path) -> Path:
    """Write the project measured, with a blunder of 0.06 mm in y of point P1, which two rays see.

    Which of the two rays an adjustment takes for the wrong one is its own choice.
    """
    template_project(folder)
    positions, operator = photo_points(folder), Operator(1, 0.0005)
    x, y = positions["left"]["P1"]
    positions["left"]["P1"] = x, y + BLUNDER
    log = operator.ticks(MOUNTED)
    for name, xy in positions.items():
        log += operator.photo(name, MOUNTED) + operator.points(name, MOUNTED, xy)
    (folder / "FIRST.MEA").write_text(log)
    return folder


def plate_coordinates(folder: Path, photo: str, point: str) -> tuple[float, float]:
    """Return what is measured of a point, as the log of a project has it."""
    block = (folder / "FIRST.MEA").read_text(encoding="utf-8").split(f"POINTS MAIN {photo}\n")[1]
    found = re.search(rf"^\s*{point} (\S+) (\S+)", block, re.MULTILINE)
    assert found
    return float(found[1]), float(found[2])


class Operator:
    """Measures ticks, marks and points of a mounted film, with errors of a standard deviation in mm."""

    def __init__(self, seed: int, error: float) -> None:
        self._chance = np.random.default_rng(seed)
        self._error = error

    def ticks(self, mounting: PlaneTransformation, kind: str = "A") -> str:
        """Return the TEMPLATE record of a mounting."""
        return f"TEMPLATE T1 {kind}\n" + lines(self._read(TICKS, mounting))

    def photo(self, name: str, mounting: PlaneTransformation, kind: str = "A") -> str:
        """Return the PHOTO record of a photo on the mounted film."""
        return f"PHOTO {name} {kind}\n" + lines(self._read(MARKS, on_plate(PHOTOS[name], mounting)))

    def points(self, name: str, mounting: PlaneTransformation, positions: dict[str, tuple[float, float]]) -> str:
        """Return the POINTS record of a photo on the mounted film."""
        return f"POINTS MAIN {name}\n" + lines(self._read(positions, on_plate(PHOTOS[name], mounting)))

    def _read(
        self, positions: dict[str, tuple[float, float]], place: PlaneTransformation
    ) -> dict[str, tuple[float, float]]:
        read = {}
        for name, xy in positions.items():
            x, y = place.apply(np.array(xy)) + self._error * self._chance.standard_normal(2)
            read[name] = float(x), float(y)
        return read


BLUNDER = 0.06
"""mm."""
MOUNTED = placed(0.7, 12.0, 8.0)
MOUNTED_AGAIN = placed(3.7, 17.0, 8.0)
"""Turned by 3 degrees, shifted by 5 mm."""
