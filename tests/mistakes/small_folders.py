"""Small project folders with one mistake each, written from a simulated block: four aerial photos or a test field."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from pathlib import Path

import numpy as np
from msgspec import Struct, field
from scipy.spatial.transform import Rotation

AERIAL = {
    f"P{number + 1}": (1000.0 + 900.0 * number, 2000.0, 1600.0, 0.3 * number - 0.4, 0.5 - 0.2 * number, 1.0)
    for number in range(4)
}
PARAMETERS = ("X0", "Y0", "Z0", "OMEGA", "PHI", "KAPPA")
Measured = dict[str, dict[str, tuple[float, float]]]
"""Photo coordinates (mm) by photo and point."""

Points = dict[str, np.ndarray]


class Folder(Struct, frozen=True):
    """What a folder has.

    Attributes
    ----------
    points : dict
        True coordinates.
    measured : dict
        Photo coordinates with noise.
    control : list of str
        Lines of the .PNT file.
    """

    points: Points
    measured: Measured
    control: list[str]
    c: float = 150.0
    frame: float = 230.0
    bundle: str = "measurement_precision = 0.005"
    given: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    more: tuple[str, ...] = ()
    preliminary: tuple[str, ...] = ()

    def write(self, folder: Path) -> Path:
        """Write the texts of the project."""
        folder.mkdir()
        lines = ["[project]", 'name = "T"', "[[camera]]", 'name = "C"', f"c = {self.c}"]
        lines += [f"frame = [{self.frame}, {self.frame}]"]
        for photo in self.measured:
            lines += ["[[photo]]", f'name = "{photo}"', 'camera = "C"']
            lines += [f"{key} = {value}" for key, value in zip(PARAMETERS, self.given.get(photo, ()), strict=False)]
        lines += ["[[bundle]]", 'name = "MAIN"', self.bundle]
        log: list[str] = []
        for photo, points in self.measured.items():
            log += [f"POINTS MAIN {photo}", *(f"  {name} {x:.4f} {y:.4f}" for name, (x, y) in points.items())]
        texts = {"orip.toml": lines, "T.MEA": [*log, *self.more], "T.PNT": self.control, "MAIN.PRE": self.preliminary}
        for name, text in texts.items():
            (folder / name).write_text("".join(f"{line}\n" for line in text))
        return folder


def terrain(relief: float, seed: int = 1) -> Points:
    random = np.random.default_rng(seed)
    return {
        f"{column}{row}": np.array([400.0 + 500.0 * column, 1000.0 + 500.0 * row, 100.0 + relief * height])
        for column in range(9)
        for row, height in enumerate(random.uniform(-1.0, 1.0, 5))
    }


def images(photos: Mapping[str, tuple[float, ...]], points: Points, c: float, half: float, noise: float) -> Measured:
    random = np.random.default_rng(2)
    found: Measured = {}
    for photo, values in photos.items():
        rotation = Rotation.from_euler("XYZ", values[3:], degrees=True).as_matrix()
        found[photo] = {}
        for name, xyz in points.items():
            u = rotation.T @ (xyz - np.array(values[:3]))
            x, y = -c * u[:2] / u[2]
            if max(abs(x), abs(y)) < half:
                dx, dy = noise * random.normal(size=2)
                found[photo][name] = (float(x + dx), float(y + dy))
    return found


def known(points: Points, error: float, names: Iterable[str] | None = None) -> list[str]:
    chosen = points if names is None else names
    return [_line(name, points[name], error) for name in chosen]


def north_first(points: Points, error: float) -> list[str]:
    return [_line(name, xyz[[1, 0, 2]], error) for name, xyz in points.items()]


def _line(name: str, xyz: np.ndarray, error: float) -> str:
    return " ".join([name, *(f"{value:.4f}" for value in xyz), *([f"{error}"] * 3)])


def changed(
    measured: Measured, photos: Iterable[str], change: Callable[[float, float], tuple[float, float]]
) -> Measured:
    """Return measurements of which those in some photos are changed."""
    chosen = set(photos)
    return {
        photo: {name: change(*xy) if photo in chosen else xy for name, xy in points.items()}
        for photo, points in measured.items()
    }


def aerial(relief: float = 60.0, photos: Mapping[str, tuple[float, ...]] = AERIAL, **texts: object) -> Folder:
    points = terrain(relief)
    return Folder(points, images(photos, points, 150.0, 115.0, 0.004), known(points, 0.02), **texts)


def flat_field() -> Folder:
    """Return six convergent photos of a flat field of 1 m with four control points, one height of which is wrong."""
    random = np.random.default_rng(3)
    points = {
        f"{row}_{column}": np.array([row / 6.0, column / 6.0, random.uniform(-0.002, 0.002)])
        for row in range(7)
        for column in range(7)
    }
    photos = {}
    for number, (azimuth, tilt) in enumerate(((0, 40), (90, 40), (180, 40), (270, 40), (45, 30), (135, 30)), start=1):
        a, t = np.radians([azimuth, tilt])
        away = 1.6 * np.array([np.sin(t) * np.cos(a), np.sin(t) * np.sin(a), np.cos(t)])
        kappa = Rotation.from_euler("Z", 90.0 * (number % 2), degrees=True)
        looking, _ = Rotation.align_vectors([away], [[0.0, 0.0, 1.0]])
        angles = (looking * kappa).as_euler("XYZ", degrees=True)
        photos[f"P{number}"] = (*(np.array([0.5, 0.5, 0.0]) + away), *angles)
    corners = ["0_0", "6_0", "0_6", "6_6"]
    wrong = {**points, "6_6": points["6_6"] - [0.0, 0.0, 0.1]}
    measured = images(photos, points, 20.0, 18.0, 0.001)
    return Folder(
        points, measured, known(wrong, 0.001, corners), c=20.0, frame=36.0, bundle="measurement_precision = 0.001"
    )
