"""Projects of a first day with orip: an object with scale bars in 40 photos, and a test field with two cameras.

Collinearity is computed here with scipy's rotations, nothing of orip.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np
from msgspec import Struct
from scipy.spatial.transform import Rotation

COLUMNS, ROWS, WIDTH, HEIGHT = 6000, 4000, 36.0, 24.0
PIXEL = WIDTH / COLUMNS
NOISE_PX = 0.25


class TrueCamera(Struct, frozen=True):
    """What a camera really has, mm."""

    c: float
    dx: float
    dy: float
    a3: float


Photos = Mapping[str, tuple[str, np.ndarray, np.ndarray]]
"""Camera, projection centre (3,) and rotation (3, 3) by name."""


def _looking(centre: np.ndarray, at: np.ndarray, kappa: float) -> np.ndarray:
    """Return the rotation of a photo that looks at a place, turned about its axis by an angle (degrees)."""
    z = (centre - at) / np.linalg.norm(centre - at)
    x = np.cross([0.0, 0.0, 1.0] if abs(z[2]) < 0.9 else [0.0, 1.0, 0.0], z)
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z], axis=1) @ Rotation.from_euler("z", kappa, degrees=True).as_matrix()


def _measurements(
    photos: Photos, cameras: Mapping[str, TrueCamera], points: Mapping[str, np.ndarray],
    normals: Mapping[str, np.ndarray], random: np.random.Generator,
) -> Iterable[str]:  # fmt: skip
    """Yield the lines of a measurement log; points whose normal looks away are hidden."""
    for photo, (name, centre, rotation) in photos.items():
        yield f"POINTS MAIN {photo}"
        camera = cameras[name]
        for point, place in points.items():
            if normals[point] @ (centre - place) < 0.3 * np.linalg.norm(centre - place):
                continue
            u = rotation.T @ (place - centre)
            ideal = -camera.c * u[:2] / u[2]
            x, y = [camera.dx, camera.dy] + ideal * (1.0 + camera.a3 * (ideal @ ideal))
            column, row = np.array([x / PIXEL + COLUMNS / 2, ROWS / 2 - y / PIXEL]) + NOISE_PX * random.normal(size=2)
            if 0.0 < column < COLUMNS and 0.0 < row < ROWS:
                yield f"  {point} {column:.2f} {row:.2f}"


def _toml(photos: Photos, cameras: Iterable[str], unknown: str, bundle: str) -> str:
    text = 'project = { name = "OBJECT" }\n'
    for camera in cameras:
        text += f'[[camera]]\nname = "{camera}"\nc = 24.0\nunknown = [{unknown}]\n'
        text += f"sensor = {{ columns = {COLUMNS}, rows = {ROWS}, width = {WIDTH}, height = {HEIGHT} }}\n"
    text += f'[[bundle]]\nname = "MAIN"\nmeasurement_precision = "{NOISE_PX}px"\n{bundle}'
    for photo, (camera, _, _) in photos.items():
        text += f'[[photo]]\nname = "{photo}"\ncamera = "{camera}"\n'
    return text


def scale_bar_project(folder: Path) -> Path:
    """Write an object of 1.5 m: 40 photos all round from two heights, 60 points, three scale bars, a free network."""
    random = np.random.default_rng(40)
    directions = random.normal(size=(60, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    normals = {f"{100 + row}": direction for row, direction in enumerate(directions)}
    points = {name: direction * [0.75, 0.75, 0.6] for name, direction in normals.items()}
    photos = {}
    for number in range(40):
        azimuth, height = 2.0 * np.pi * number / 20.0 + 0.1 * (number >= 20), (0.4 if number < 20 else 1.6)
        centre = np.array([2.6 * np.cos(azimuth), 2.6 * np.sin(azimuth), height]) + 0.05 * random.normal(size=3)
        photos[f"IMG_{number + 1:04d}"] = ("D750", centre, _looking(centre, np.zeros(3), 90.0 * (number % 4 == 3)))
    lines = []
    for number, direction in enumerate(np.eye(3), start=1):
        # the two ends of a bar lie beside each other, seen by the same photos
        place, across = 0.85 * direction, 0.35 * np.roll(direction, 1)
        for end, sign in (("a", -1.0), ("b", 1.0)):
            points[f"B{number}{end}"], normals[f"B{number}{end}"] = place + sign * across, direction
        length = 0.7 + 0.00005 * random.normal()
        lines.append(f"BAR{number} B{number}a B{number}b XYZ {length:.5f} 0.00005")
    cameras = {"D750": TrueCamera(24.31, 0.08, -0.05, -4.0e-5)}
    folder.mkdir()
    log = _measurements(photos, cameras, points, normals, random)
    (folder / "OBJECT.MEA").write_text("\n".join(log) + "\n", encoding="utf-8")
    (folder / "OBJECT.LEN").write_text("\n".join(lines) + "\n", encoding="utf-8")
    text = _toml(photos, cameras, '"C", "DX", "DY", "A3"', 'datum = "free"\n')
    (folder / "orip.toml").write_text(text, encoding="utf-8")
    return folder


def two_camera_project(folder: Path) -> Path:
    """Write a calibration of two cameras with 8 photos each of a test field with relief, whose corners are known."""
    random = np.random.default_rng(2)
    points = {
        f"{column}{row}": np.array([0.25 * column, 0.25 * row, 0.15 * random.uniform()])
        for column in range(7)
        for row in range(5)
    }
    normals = dict.fromkeys(points, np.array([0.0, 0.0, 1.0]))
    photos = {}
    for number in range(8):
        azimuth = np.pi * number / 4.0
        for name, camera in (("L", "LEFT"), ("R", "RIGHT")):
            centre = np.array([0.75 + 1.1 * np.cos(azimuth), 0.5 + 1.1 * np.sin(azimuth), 1.5])
            centre += 0.05 * random.normal(size=3)
            rotation = _looking(centre, np.array([0.75, 0.5, 0.0]), 90.0 * number)
            photos[f"{name}{number + 1:02d}"] = (camera, centre, rotation)
    cameras = {"LEFT": TrueCamera(24.15, 0.10, -0.06, -4.0e-5), "RIGHT": TrueCamera(24.42, -0.12, 0.09, -6.0e-5)}
    folder.mkdir()
    log = _measurements(photos, cameras, points, normals, random)
    (folder / "OBJECT.MEA").write_text("\n".join(log) + "\n", encoding="utf-8")
    known = [name for name in points if name in {"00", "60", "04", "64", "32"}]
    control = [f"{name} {' '.join(f'{value:.5f}' for value in points[name])} 0.0002 0.0002 0.0002" for name in known]
    (folder / "OBJECT.PNT").write_text("\n".join(control) + "\n", encoding="utf-8")
    (folder / "orip.toml").write_text(_toml(photos, cameras, '"C", "DX", "DY", "A3"', ""), encoding="utf-8")
    return folder
