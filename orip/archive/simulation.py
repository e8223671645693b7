"""`orip archive simulate`: a folder of simulated projects to try an archive on, some with mistakes."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Final, Literal

import numpy as np
from msgspec import Struct

from orip.arrays import FloatArray
from orip.errors import UsageError
from orip.files.text.atomic import reporting_failure, write_new_folder
from orip.geometry.rotation import rotation_from_angles
from orip.progress import stage

# Flying heights, cameras, relief, overlap and precision differ from project to project; equal numbers and seeds give
# equal projects. Collinearity is that of `orip.geometry`; what tests orip's formulas is elsewhere.

Fault = Literal["", "control point", "measured point", "measurement text", "too little control", "gate"]
"""What is wrong in a project: a coordinate of control, a photo point, a line that cannot be read, one control point
alone, a gate that cannot be passed."""

FAULTS: Final[tuple[Fault, ...]] = (
    "control point", "measured point", "measurement text", "too little control", "gate",
)  # fmt: skip

_STRIPS, _PHOTOS_A_STRIP = 2, 6
_MARGIN = 0.03
"""Part of the frame at each side in which nothing is measured."""
_NOISE_PX = 0.4
_CONTROL_ERROR, _CHECK_ERROR = 0.02, 0.03
_PROJECTS_A_CAMERA_STORE = 25
"""Every so many projects use the cameras of the first of them."""


class _Camera(Struct, frozen=True):
    name: str
    c: float
    columns: int
    rows: int
    width: float

    @property
    def pixel(self) -> float:
        """Return the size of a pixel, mm."""
        return self.width / self.columns

    @property
    def frame(self) -> FloatArray:
        """Return width and height, mm."""
        return np.array([self.width, self.rows * self.pixel])


_CAMERAS: Final = (
    _Camera("UCD", 101.4, 7500, 11500, 67.5),
    _Camera("DMC", 120.0, 7680, 13824, 92.16),
    _Camera("RCD30", 53.0, 8956, 6708, 53.736),
    _Camera("P4", 8.8, 5472, 3648, 13.2),
)


class SimulatedProject(Struct, frozen=True):
    """A simulated project.

    Parameters
    ----------
    folder : str
        Its folder in the archive, with slashes.
    fault : Fault
        What is wrong in it; empty: nothing.
    texts : mapping of str to str
        Its files by name, orip.toml last.
    """

    folder: str
    fault: Fault
    texts: Mapping[str, str]


def simulated_project(number: int, seed: int, faults: float) -> SimulatedProject:
    """Return a project of twelve photos.

    Parameters
    ----------
    number : int
        From 0; the same project whatever others there are.
    faults : float
        Part of the projects that have a fault, 0 to 1.
    """
    random = np.random.default_rng([seed, number])
    leader = number - number % _PROJECTS_A_CAMERA_STORE
    shares = number != leader and random.random() < 0.2
    fault: Fault = FAULTS[int(random.integers(len(FAULTS)))] if random.random() < faults else ""
    camera = _CAMERAS[int(np.random.default_rng([seed, leader if shares else number, 1]).integers(len(_CAMERAS)))]
    flight = _flight(camera, random)
    name = f"{camera.name}_{number:06d}"
    folder = _folder(number)
    lines = _measured(flight, camera, fault, random)
    texts = {
        f"{name}.MEA": lines,
        f"{name}.PNT": _control(flight, fault, random),
        "orip.toml": _definition(name, camera, flight, fault, f"{_folder_from(number, leader)}" if shares else ""),
    }
    return SimulatedProject(folder, fault, texts)


def _folder(number: int) -> str:
    """Return the folder: years, as archives have them, of a hundred projects."""
    return f"{1990 + number // 100}/job_{number:06d}"


def _folder_from(number: int, leader: int) -> str:
    year = "" if number // 100 == leader // 100 else f"../{1990 + leader // 100}/"
    return f"../{year}job_{leader:06d}/CAMERAS.CAM"


class _Flight(Struct, frozen=True):
    photos: tuple[str, ...]
    centres: FloatArray
    angles: FloatArray
    points: Mapping[str, FloatArray]


def _flight(camera: _Camera, random: np.random.Generator) -> _Flight:
    """Return two strips over rolling ground, with points where they are wanted for measuring."""
    height = camera.c / camera.pixel * random.uniform(0.03, 0.10)  # ground sampling distance of 3 to 10 cm
    size = camera.frame * height / camera.c
    base, spacing = 0.38 * size[0], 0.68 * size[1]
    rows, columns = np.divmod(np.arange(_STRIPS * _PHOTOS_A_STRIP), _PHOTOS_A_STRIP)
    origin = np.round(random.uniform([2.0e5, 5.2e6, 50.0], [7.0e5, 5.9e6, 600.0]), -1)
    centres = origin + np.stack([columns * base, rows * spacing, np.full(len(rows), height)], axis=1)
    centres += random.normal(size=centres.shape) * [0.02 * base, 0.02 * spacing, 0.01 * height]
    turned = np.where(rows % 2 == 0, 0.0, 180.0)
    angles = np.radians(random.normal(size=centres.shape) * [1.0, 1.0, 2.0] + np.outer(turned, [0.0, 0.0, 1.0]))
    names = tuple(
        f"{100 * (row + 1) + column + 1}" for row, column in zip(rows.tolist(), columns.tolist(), strict=True)
    )
    east = np.arange(-0.5 * base, (_PHOTOS_A_STRIP - 0.4) * base, 0.5 * base)
    north = np.linspace(-0.45 * size[1], spacing + 0.45 * size[1], 8)
    plan = np.stack(np.meshgrid(east, north), axis=-1).reshape(-1, 2)
    plan = plan + random.uniform(-0.1, 0.1, plan.shape) * base
    wave = 0.05 * height * np.sin(plan[:, 0] / base + 1.0) * np.cos(plan[:, 1] / spacing)
    ground = origin + np.column_stack([plan, wave + random.normal(size=len(plan)) * 0.01 * height])
    return _Flight(names, centres, angles, {str(1001 + place): row for place, row in enumerate(ground)})


def _measured(flight: _Flight, camera: _Camera, fault: Fault, random: np.random.Generator) -> str:
    """Return the measurement file: pixels from the upper left corner, of all points that two photos show."""
    points, names = np.array(list(flight.points.values())), list(flight.points)
    rotations = rotation_from_angles(flight.angles)
    rays = np.einsum("pnj,pjk->pnk", points[None] - flight.centres[:, None], rotations)
    xy = -camera.c * rays[..., :2] / rays[..., 2:]
    xy += _NOISE_PX * camera.pixel * random.normal(size=xy.shape)
    inside = (np.abs(xy) < (0.5 - _MARGIN) * camera.frame).all(axis=2)
    inside &= inside.sum(axis=0) > 1
    pixels = (xy * [1.0, -1.0] + camera.frame / 2.0) / camera.pixel
    lines = []
    for photo, at, seen in zip(flight.photos, pixels, inside, strict=True):
        lines.append(f"POINTS MAIN {photo}")
        lines += [f"{names[row]:6} {at[row, 0]:10.2f} {at[row, 1]:10.2f}" for row in np.flatnonzero(seen)]
    return "".join(f"{line}\n" for line in _with_fault(lines, fault))


def _with_fault(lines: list[str], fault: Fault) -> list[str]:
    """Return the lines of a measurement file with a mistake in one of them, if it is of that kind."""
    place = next(row for row in range(len(lines) // 2, len(lines)) if not lines[row].startswith("POINTS"))
    name, x, y = lines[place].split()
    if fault == "measured point":
        lines[place] = f"{name:6} {float(x) + 40.0:10.2f} {y:>10}"
    elif fault == "measurement text":
        lines[place] = lines[place].replace(".", ",", 1)
    return lines


def _control(flight: _Flight, fault: Fault, random: np.random.Generator) -> str:
    """Return the control: the four corners and the middle; check points between them."""
    points = np.array(list(flight.points.values()))
    names = list(flight.points)
    low, high = flight.centres.min(axis=0)[:2], flight.centres.max(axis=0)[:2]
    parts = [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0), (0.5, 0.5), (0.25, 0.4), (0.75, 0.6), (0.5, 0.1)]
    chosen: dict[int, bool] = {}
    for place, part in enumerate(parts):
        distance = np.linalg.norm(points[:, :2] - (low + (high - low) * part), axis=1)
        free = [row for row in np.argsort(distance).tolist() if row not in chosen]
        chosen[free[0]] = place < 5
    lines = []
    for place, (row, is_control) in enumerate(chosen.items()):
        if fault == "too little control" and 0 < place < 5:
            continue
        error = _CONTROL_ERROR if is_control else _CHECK_ERROR
        given = points[row] + error * random.normal(size=3)
        if fault == "control point" and place == 2:
            given[2] += 3.0
        sign = 1.0 if is_control else -1.0
        lines.append(" ".join([names[row], *(f"{value:.3f}" for value in given), *[f"{sign * error:g}"] * 3]))
    return "".join(f"{line}\n" for line in lines)


def _definition(name: str, camera: _Camera, flight: _Flight, fault: Fault, shared: str) -> str:
    height = camera.rows * camera.pixel
    gate = "1e-3" if fault == "gate" else "1.5"
    sensor = f"columns = {camera.columns}, rows = {camera.rows}, width = {camera.width}, height = {height:.6g}"
    parts = [
        f'[project]\nname = "{name}"\nuser = "simulated"\nground_unit = "m"',
        f'[check]\ngates = ["sigma0<={gate}", "check_points.max<=0.5"]',
        f'[[camera]]\nname = "{camera.name}"\nc = {camera.c}\nsensor = {{ {sensor} }}',
        '[[bundle]]\nname = "MAIN"\nmeasurement_precision = "0.4px"',
        *(f'[[photo]]\nname = "{photo}"\ncamera = "{camera.name}"' for photo in flight.photos),
    ]
    if shared:
        parts[0] += f'\ncamera_file = "{shared}"'
    return "\n\n".join(parts) + "\n"


class SimulatedArchive(Struct, frozen=True):
    """What was written: the folder, the number of projects, and how many of them have a fault, by its kind."""

    folder: Path
    projects: int
    faults: Counter[str]


def simulate_archive(folder: Path, projects: int, seed: int, faults: float) -> SimulatedArchive:
    """Write simulated projects into a new or empty folder.

    Raises
    ------
    UsageError
        If the folder has something in it.
    OripError
        If the disk refuses.
    """
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        message = f"'{folder}' has something in it already; name a new or empty folder"
        raise UsageError(message)
    planted: Counter[str] = Counter()
    with (
        stage("simulate", projects) as advance,
        reporting_failure(folder, "remove the cause, then name a new or empty folder"),
    ):
        for number in range(projects):
            project = simulated_project(number, seed, faults)
            write_new_folder(folder / project.folder, project.texts)
            if project.fault:
                planted[project.fault] += 1
            advance(number + 1)
    return SimulatedArchive(folder, projects, planted)
