"""Project folders of five vertical photos over nearly flat ground, in which nothing is given but control."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

C, SIZE, PIXELS = 124.0, np.array([53.148, 77.976]), np.array([8858, 12996])
CENTRES = [(-350, -50, 1905), (50, 180, 1912), (80, -30, 1908), (100, -250, 1906), (480, -60, 1935)]
ANGLES = [(0.8, -0.4, -90.0), (-0.15, 0, 92.6), (-0.19, 0, 94.4), (-0.19, 0.13, 96.1), (0.48, -0.26, -92.5)]
FOOT = 0.3048


class FlatBlock:
    """Pixels `measured` by photo and point, and `control` coordinates by point; both may be changed before writing.

    Parameters
    ----------
    relief : float
        Metres.
    seed : int
    scale : float
        Of all lengths on the ground: a thousandth makes a test field on a table of it.
    from_below : bool
        Really: a ceiling.

    `matched`: each ray is written with an error of its own, as matching does.
    """

    matched = False

    def __init__(self, relief: float, seed: int = 11, scale: float = 1.0, *, from_below: bool = False) -> None:
        random = np.random.default_rng(seed)
        low, high = (-700, -500, 139 - relief / 2), (900, 500, 139 + relief / 2)
        points = {str(200 + number): random.uniform(low, high) for number in range(24)}
        self.measured: dict[str, dict[str, np.ndarray]] = {}
        up = np.diag([1.0, -1.0, -1.0]) if from_below else np.eye(3)
        for number, (centre, angles) in enumerate(zip(CENTRES, ANGLES, strict=True), 1):
            rotation = Rotation.from_euler("XYZ", angles, degrees=True).as_matrix()
            of_photo = self.measured.setdefault(f"P{number}", {})
            for name, xyz in points.items():
                u = rotation.T @ (xyz - centre)
                xy = -C * u[:2] / u[2] + [0.003, 0.18]
                if (np.abs(xy) < SIZE / 2).all():
                    pixels = (xy * [1, -1] + SIZE / 2) / (SIZE / PIXELS)
                    of_photo[name] = pixels + random.normal(0.0, 0.8, 2)
        self.errors = np.array([0.02, 0.02, 0.04]) * scale
        shift = [1e5, 2e5, 0.0]
        self.control = {
            name: scale * (up @ points[name]) + shift + random.normal(0.0, self.errors) for name in list(points)[:18]
        }

    def write(self, folder: Path) -> Path:
        """Write the texts of the project."""
        folder.mkdir()
        lines = ['[project]\nname = "B"\n[[camera]]\nname = "CAM"', f"c = {C}\nprincipal_point = [0.003, 0.18]"]
        lines += [
            f"sensor = {{ columns = {PIXELS[0]}, rows = {PIXELS[1]}, width = {SIZE[0]}, height = {SIZE[1]} }}",
            *(f'[[photo]]\nname = "{name}"\ncamera = "CAM"' for name in self.measured),
            '[[bundle]]\nname = "MAIN"\nmeasurement_precision = "1px"',
        ]
        log = []
        for photo, points in self.measured.items():
            log.append(f"POINTS MAIN {photo}")
            for number, (name, (x, y)) in enumerate(points.items()):
                error = f"{0.9 + 0.01 * number + 0.001 * float(photo[1:]):.3f}px"
                log.append(f"  {name} {x:.4f} {y:.4f}" + (f" {error} {error}" if self.matched else ""))
        errors = " ".join(f"{error:.6f}" for error in self.errors)
        control = [f"{name} {x:.6f} {y:.6f} {z:.6f} {errors}" for name, (x, y, z) in self.control.items()]
        for name, text in {"orip.toml": lines, "B.MEA": log, "B.PNT": control}.items():
            (folder / name).write_text("\n".join(text) + "\n")
        return folder
