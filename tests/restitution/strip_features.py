"""The project of two strips with stereo measurements of known places."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from cli.command_line import orip
from scipy.spatial.transform import Rotation
from support.strips_project import C, StripsProject, strips_project

PLACES = {
    "LINE ROAD 1": [("P1", "P2", (5.0, 2.0, 4.0)), ("P1", "P2", (15.0, 3.0, 5.0)), ("P2", "P3", (40.0, 4.0, 6.0))],
    "AREA HOUSE 7": [("P1", "P2", (x, y, 8.0)) for x, y in ((8, -8), (16, -8), (16, -2), (8, -2))],
    "POINT TREE A": [("P2", "P3", (38.0, -9.0, 12.0))],
    "LINE PATH 1": [("P2", "P3", (40.03, 4.02, 6.01)), ("P2", "P3", (45.0, -4.0, 3.0))],
}


def image(project: StripsProject, photo: str, xyz: tuple[float, ...]) -> np.ndarray:
    *centre, omega, phi, kappa = project.true_orientations[photo]
    rotation = Rotation.from_euler("XYZ", (omega, phi, kappa), degrees=True).as_matrix()
    u = (np.array(xyz) - centre) @ rotation
    return -C * u[:2] / u[2]


def stereo_text(project: StripsProject) -> str:
    lines = []
    for header, vertices in PLACES.items():
        lines.append(header)
        for left, right, xyz in vertices:
            (x1, y1), (x2, y2) = image(project, left, xyz), image(project, right, xyz)
            lines.append(f"  {left} {x1:.6f} {y1:.6f} {right} {x2:.6f} {y2:.6f}")
    return "\n".join(lines) + "\n"


def restituted_project(folder: Path) -> Path:
    """Make the project, adjust it, and write its stereo measurements."""
    project = strips_project()
    project.write(folder)
    (folder / "STEREO.STE").write_text(stereo_text(project), encoding="utf-8")
    assert orip(folder, "run", "--no-report").code == 0
    return folder
