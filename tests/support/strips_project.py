"""Two flight strips as a project folder of text: six photos, models in two rows, nothing preliminary.

Photo coordinates are computed with scipy's rotations and carry no error but what a test puts in.
"""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
from msgspec import Struct, field
from scipy.spatial.transform import Rotation

C = 50.0
FRAME = 36.0
HEIGHT = 100.0
BASE, SPACING = 27.0, 45.0
"""m: photos of a strip share 62 % of 72 m, the strips 37 %."""

CONTROL_ERROR = 0.02
CONTROL_NEAR = {"C1": (2.0, -16.0), "C2": (52.0, -18.0), "C3": (2.0, 58.0), "C4": (52.0, 60.0), "C5": (28.0, 22.0)}

ROWS = {1: ("P1", "P2", "P3"), 2: ("P4", "P5", "P6")}
MODELS = {
    f"{row}-{column}": (left, right, row, column)
    for row, names in ROWS.items()
    for column, (left, right) in enumerate(pairwise(names), start=1)
}
"""Left and right photo, row and column."""

Point = tuple[float, ...]


class StripsProject(Struct):
    """What is measured and given; a test changes it before it is written.

    Attributes
    ----------
    images : dict by photo of dicts by point
        x, y, mm.
    control : dict by point
        X, Y, Z, m.
    models : dict by name
        Left and right photo, row and column.
    orientations : dict by photo
        X0 ... KAPPA as known; empty.
    true_orientations, points : dicts
        The truth, m and degrees.
    settings : str
        Lines of the bundle.
    """

    images: dict[str, dict[str, Point]]
    control: dict[str, Point]
    true_orientations: dict[str, Point]
    points: dict[str, Point]
    models: dict[str, tuple[str, str, int, int]] = field(default_factory=lambda: dict(MODELS))
    orientations: dict[str, str] = field(default_factory=dict)
    settings: str = ""

    def exchange_points(self, photo: str, first: str, second: str) -> None:
        """Measure two points of a photo under each other's numbers."""
        marks = self.images[photo]
        marks[first], marks[second] = marks[second], marks[first]

    def exchange_photos(self, first: str, second: str) -> None:
        """Measure two photos under each other's names."""
        self.images[first], self.images[second] = self.images[second], self.images[first]

    def common(self, *photos: str) -> list[str]:
        """Return the points that all of some photos show."""
        return sorted(set.intersection(*(set(self.images[photo]) for photo in photos)))

    def write(self, folder: Path) -> Path:
        """Write orip.toml, STRIPS.MEA and STRIPS.PNT."""
        folder.mkdir(exist_ok=True)
        parts = ['project = { name = "STRIPS", ground_unit = "m" }', f'[[camera]]\nname = "CAM"\nc = {C}']
        parts += [
            f'[[photo]]\nname = "{name}"\ncamera = "CAM"\n{self.orientations.get(name, "")}' for name in self.images
        ]
        parts.append(f'[[bundle]]\nname = "MAIN"\nmeasurement_precision = 0.003\n{self.settings}')
        parts += [
            f'[[bundle.model]]\nname = "{name}"\nleft = "{left}"\nright = "{right}"\nrow = {row}\ncolumn = {column}'
            for name, (left, right, row, column) in self.models.items()
        ]
        (folder / "orip.toml").write_text("\n\n".join(parts) + "\n", encoding="utf-8")
        log = []
        for photo, marks in self.images.items():
            log += [f"POINTS MAIN {photo}", *(f"{name} {x:.6f} {y:.6f}" for name, (x, y) in marks.items())]
        (folder / "STRIPS.MEA").write_text("\n".join(log) + "\n", encoding="utf-8")
        control = [
            " ".join([name, *(f"{value:.4f}" for value in xyz), *[str(CONTROL_ERROR)] * 3])
            for name, xyz in self.control.items()
        ]
        (folder / "STRIPS.PNT").write_text("".join(f"{line}\n" for line in control), encoding="utf-8")
        return folder


def strips_project(noise_mm: float = 0.0) -> StripsProject:
    """Return two strips over a hilly landscape, photos tilted by some degrees."""
    random = np.random.default_rng(89482)
    names = [name for row in ROWS.values() for name in row]
    centres = np.array([[BASE * column, SPACING * row, HEIGHT] for row in (0, 1) for column in (0, 1, 2)])
    centres += 2.0 * random.normal(size=centres.shape)
    angles = random.normal(size=centres.shape) * [2.0, 2.0, 5.0]
    points = _landscape(random)
    images: dict[str, dict[str, Point]] = {}
    for name, centre, turned in zip(names, centres, angles, strict=True):
        rotation = Rotation.from_euler("XYZ", turned, degrees=True).as_matrix()
        u = (np.array(list(points.values())) - centre) @ rotation
        xy = -C * u[:, :2] / u[:, 2:]
        seen = (np.abs(xy) < FRAME / 2.0).all(axis=1)
        noisy = xy + noise_mm * random.normal(size=xy.shape)
        images[name] = {
            point: tuple(at) for point, at, shown in zip(points, noisy.tolist(), seen, strict=True) if shown
        }
    seen_twice = {point for point in points if sum(point in marks for marks in images.values()) > 1}
    return StripsProject(
        images={photo: {k: v for k, v in marks.items() if k in seen_twice} for photo, marks in images.items()},
        control={name: points[name] for name in CONTROL_NEAR},
        true_orientations={
            name: (*centre, *turned)
            for name, centre, turned in zip(names, centres.tolist(), angles.tolist(), strict=True)
        },
        points={name: points[name] for name in points if name in seen_twice},
    )


def _landscape(random: np.random.Generator) -> dict[str, Point]:
    """Return tie points 12 m from each other and control points, 12 m of relief."""
    x, y = np.meshgrid(np.arange(-30.0, 90.0, 12.0), np.arange(-30.0, 80.0, 12.0))
    plan = np.stack([x.ravel(), y.ravel()], axis=1) + random.uniform(-3.0, 3.0, (x.size, 2))
    names = [*CONTROL_NEAR, *(str(101 + number) for number in range(len(plan)))]
    plan = np.vstack([list(CONTROL_NEAR.values()), plan])
    heights = 6.0 + 6.0 * np.sin(plan[:, 0] / 13.0) * np.cos(plan[:, 1] / 17.0) + random.uniform(-1.0, 1.0, len(plan))
    return {name: (*map(float, at), float(z)) for name, at, z in zip(names, plan, heights, strict=True)}
