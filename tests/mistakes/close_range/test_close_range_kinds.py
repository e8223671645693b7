"""Mistakes of beginners at a convergent close-range object, of which nothing but the photos says what is wrong."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from cli.command_line import orip
from mistakes.advice import is_well, said_first
from msgspec import Struct, field
from scipy.spatial.transform import Rotation
from support.long_cases import with_long

COLUMNS, ROWS, WIDTH, C = 7952, 5304, 35.9, 24.3
PIXEL = WIDTH / COLUMNS
PHOTOS, POINTS = 14, 70
LONGER = 1.05

Angles = dict[str, np.ndarray]


class Project(Struct):
    """A tank of 3 m height, seen from a ring: what is written of it."""

    lenses: dict[str, float] = field(default_factory=dict)
    height: float = PIXEL * ROWS
    size: tuple[int, int] = (COLUMNS, ROWS)
    angles: Angles = field(default_factory=dict)
    renamed: dict[str, str] = field(default_factory=dict)
    of_positions: str = ""
    lower_case: bool = False

    def write(self, folder: Path) -> Path:
        """Write the texts of the project."""
        random = np.random.default_rng(8)
        points = random.uniform([498.6, 298.6, 40.0], [501.4, 301.4, 43.0], (POINTS, 3))
        names = [self.renamed.get(str(number), str(number)) for number in range(101, 101 + POINTS)]
        control = [_line(names[row], points[row] + random.normal(scale=6e-4, size=3), 6e-4) for row in range(0, 42, 6)]
        toml = f'[project]\nname = "T"\n[[camera]]\nname = "A"\nc = {C}\nunknown = ["C", "DX", "DY", "A3"]\n'
        toml += f"sensor = {{ columns = {self.size[0]}, rows = {self.size[1]}, width = {WIDTH}, height = {self.height} "
        toml += '}\n[[bundle]]\nname = "M"\nmeasurement_precision = "0.3px"\n'
        log, places = "", []
        for number, turn in enumerate(np.linspace(0.0, 2.0 * np.pi, PHOTOS, endpoint=False)):
            photo = f"Dsc{number + 1}"
            toml += f'[[photo]]\nname = "{photo}"\ncamera = "A"\n'
            centre = np.array([500.0 + 5.4 * np.cos(turn), 300.0 + 5.4 * np.sin(turn), 41.2 + 1.6 * (number % 2)])
            rotation = _looking_at(points.mean(axis=0) - centre, 90.0 * (number % 3))
            seen = (points - centre) @ rotation
            xy = -self.lenses.get(photo, 1.0) * C * seen[:, :2] / seen[:, 2:] / PIXEL
            pixels = xy * [1.0, -1.0] + [COLUMNS / 2, ROWS / 2] + random.normal(scale=0.3, size=(POINTS, 2))
            inside = ((pixels > 0.0) & (pixels < [COLUMNS, ROWS])).all(axis=1)
            log += f"POINTS M {photo}\n" + "".join(
                f"{names[row]} {pixels[row, 0]:.3f} {pixels[row, 1]:.3f}\n" for row in np.flatnonzero(inside)
            )
            kinds = [*zip(("X0", "Y0", "Z0"), centre + random.normal(scale=0.003, size=3), (0.003,) * 3, strict=True)]
            if self.angles:
                angles = self.angles["factor"] * Rotation.from_matrix(rotation).as_euler("XYZ", degrees=True)
                kinds += [*zip(("OMEGA", "PHI", "KAPPA"), angles, (0.05,) * 3, strict=True)]
            shown = photo.lower() if self.lower_case else photo
            places += [f"{shown} PHOTO {kind} {value:.5f} {error}\n" for kind, value, error in kinds]
        folder.mkdir()
        texts = {"orip.toml": toml, "T.PNT": "".join(control), "T.MEA": log}
        texts |= {"T.ELE": "".join(places)} if self.of_positions else {}
        for name, text in texts.items():
            (folder / name).write_text(text)
        return folder


def _line(name: str, xyz: np.ndarray, error: float) -> str:
    return f"{name} {' '.join(f'{value:.5f}' for value in xyz)}{f' {error}' * 3}\n"


def _looking_at(direction: np.ndarray, roll: float) -> np.ndarray:
    back = -direction / np.linalg.norm(direction)
    right = np.cross([0.0, 0.0, 1.0], back)
    right /= np.linalg.norm(right)
    upright = np.column_stack([right, np.cross(back, right), back])
    return np.asarray(upright @ Rotation.from_euler("Z", roll, degrees=True).as_matrix())


SECOND = {f"Dsc{number}": LONGER for number in range(9, PHOTOS + 1)}

SAID: dict[str, tuple[Project, tuple[str, ...]]] = {
    "two lenses": (Project(lenses=SECOND), ("photos Dsc9, Dsc10, Dsc11 and 3 more", "C = 25.5", "another lens")),
    "a photo of another zoom": (Project(lenses={"Dsc4": 1.17}), ("photo Dsc4: it fits with C = 28.4", "another lens")),
    "the same with positions": (
        Project(lenses={"Dsc4": 1.17}, of_positions="ELE"), ("photo Dsc4: it fits with C = 28.4", "another lens")),
    "height of the sensor from the data sheet": (
        Project(height=24.0), ("camera A", "square pixels", "write height = 23.945", '"B1"]')),
    "columns and rows of larger pictures": (
        Project(size=(2 * COLUMNS, 2 * ROWS)), ("upper left corner", "lower resolution", "columns and rows")),
    "OMEGA, PHI and KAPPA in gon in .ELE": (
        Project(of_positions="ELE", angles={"factor": np.full(3, 1.0 / 0.9)}), (".ELE file", "in gon", "by 0.9")),
    "sign of KAPPA in .ELE": (
        Project(of_positions="ELE", angles={"factor": np.array([1.0, 1.0, -1.0])}), (".ELE file", "sign of KAPPA")),
    "numbers of points with a blank": (
        Project(renamed={str(number): f"1 {number}" for number in range(101, 171)}), ("no blank", "write '1_10")),
}  # fmt: skip
"""What is written, and words of what is said first."""


@pytest.mark.parametrize("name", with_long(("sign of KAPPA in .ELE", "the same with positions"), SAID))
def test_the_first_sentence_names_the_cause_and_the_mend(name: str, tmp_path: Path) -> None:
    project, words = SAID[name]
    first = said_first(orip(project.write(tmp_path / "p"), "run", "--no-report"))
    missing = [word for word in words if word not in first]
    assert not missing, f"{missing} not in {first}"


@pytest.mark.parametrize(
    "project",
    [
        Project(),
        Project(of_positions="ELE"),
        Project(of_positions="ELE", lower_case=True),
        Project(of_positions="ELE", angles={"factor": np.ones(3)}),
    ],
    ids=["control alone", "positions", "positions in lower case", "positions and angles"],
)
def test_nothing_is_said_of_what_is_right(project: Project, tmp_path: Path) -> None:
    assert is_well(orip(project.write(tmp_path / "p"), "run", "--no-report"))
