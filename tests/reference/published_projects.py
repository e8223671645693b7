"""A published data set as a project folder: orip.toml, .PNT, .PRE and .MEA, all of it text."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from msgspec import Struct, field
from reference.published_data import ORIENTATION
from workflow.quiet import run_quietly

Mark = tuple[str, ...]
"""Photo, point, column and row, and its a-priori error in pixels if it has its own."""


class Project(Struct, frozen=True):
    """What goes into a project folder; `stations` in the order of `ORIENTATION`, ground unit and degrees."""

    camera: str
    stations: Mapping[str, Sequence[float]]
    marks: Iterable[Mark]
    control: Mapping[str, Sequence[float]] = field(default_factory=dict)
    preliminary: Mapping[str, Sequence[float]] = field(default_factory=dict)
    bundle: str = ""
    enp_stop: float = 7.0

    def write(self, folder: Path) -> Path:
        """Write the folder's text files."""
        folder.mkdir(exist_ok=True)
        (folder / "orip.toml").write_text(self._toml(), encoding="utf-8")
        (folder / "BLOCK.MEA").write_text(self._log(), encoding="utf-8")
        for extension, points in (("PNT", self.control), ("PRE", self.preliminary)):
            lines = [f"{name} {' '.join(map(repr, numbers))}\n" for name, numbers in points.items()]
            (folder / f"BLOCK.{extension}").write_text("".join(lines), encoding="utf-8")
        return folder

    def _toml(self) -> str:
        parts = ['project = { name = "BLOCK" }', self.camera]
        for name, station in self.stations.items():
            values = [f"{kind} = {float(value)!r}" for kind, value in zip(ORIENTATION, station, strict=True)]
            parts.append("\n".join(["[[photo]]", f'name = "{name}"', 'camera = "CAM"', *values]))
        # The published adjustments have no robust weights: down-weighting that begins with the last iteration is off.
        # Published figures have up to six digits below the standard deviation; enp_stop asks for one more than that.
        parts.append(f'[[bundle]]\nname = "BLOCK"\nstart_down_weight = 20\nenp_stop = {self.enp_stop}\n{self.bundle}')
        return "\n\n".join(parts) + "\n"

    def _log(self) -> str:
        by_photo: dict[str, list[str]] = {}
        for photo, point, column, row, *error in self.marks:
            own = [f"{size}px" for size in error * 2]
            by_photo.setdefault(photo, []).append(" ".join([point, column, row, *own]))
        return "".join(f"POINTS BLOCK {photo}\n" + "\n".join(lines) + "\n" for photo, lines in by_photo.items())


def result_of(project: Project, folder: Path) -> Any:
    """Run the whole project in a new folder and return its result.json."""
    run_quietly(project.write(folder))
    return json.loads((folder / "result.json").read_text(encoding="utf-8"))


def perturbed(
    stations: Mapping[str, Sequence[float]], length: float, angle: float, seed: int
) -> dict[str, tuple[float, ...]]:
    """Return stations moved by normal errors of `length` (ground unit) and turned by some of `angle` (degrees)."""
    errors = np.random.default_rng(seed).standard_normal((len(stations), 6)) * ([length] * 3 + [angle] * 3)
    return {
        name: tuple((np.array(station) + error).tolist())
        for (name, station), error in zip(stations.items(), errors, strict=True)
    }
