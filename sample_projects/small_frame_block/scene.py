"""The truth of the small frame block, and the way from the cliff to the stage plate: photo, sheet, film, plate.

The formulas are those of docs/conventions.md, with SciPy's rotations; nothing of orip is used.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

CAMERA = {"C": 35.412, "DX": 0.187, "DY": -0.124, "A3": -3.1e-5, "A5": 3.2e-8}
STRIPS = {1: (-66.0, 102.0, 68.0), 2: (-80.0, 28.0, 88.5)}
"""Y0, Z0 (m) and OMEGA (degrees) that were planned."""
FIRST_X0, BASE = 46.0, 34.0
OFF_PLAN = (1.2, 1.2, 1.2, 1.2, 1.2, 1.2)
"""Standard deviations of X0, Y0, Z0 (m) and OMEGA, PHI, KAPPA (degrees) of a hand-held camera about the plan."""

TARGETS = {
    "CP1": (72.0, 9.0), "CP2": (190.0, 8.0), "CP3": (68.0, 83.0), "CP4": (195.0, 84.0), "CP5": (131.0, 45.0),
    "CK1": (92.0, 60.0), "CK2": (170.0, 30.0), "CK3": (112.0, 8.0),
}  # fmt: skip
"""X and Z of targets on the cliff; CP are control points, CK check points."""
TIES_X, TIES_Z = (32.0, 232.0, 9.3), (3.0, 90.0, 9.2)
"""From, to and spacing of what could be tie points, m."""

SLOTS = ((-72.0, 36.0), (0.0, 36.0), (72.0, 36.0), (-72.0, -36.0), (0.0, -36.0), (72.0, -36.0))
"""Where the photos of a template are printed, in the order of its list (mm)."""
FILM_SCALE = {"LEFT": (0.99964, 0.99948), "RIGHT": (0.99971, 0.99943)}
"""What shrinkage made of the sheets, along x and y."""
RIPPLES, RIPPLE_MM, RIPPLE_LENGTH_MM = 4, 0.0007, (15.0, 60.0)
"""The rest of the film deformation: so many waves across a sheet, their rms and their lengths."""

Array = NDArray[np.float64]
Project = Mapping[str, Any]


@dataclass(frozen=True)
class Ripple:
    """A wave across a film sheet: `amplitude` (mm, in x and y) times sin(kx x + ky y + phase), x and y in mm."""

    amplitude: tuple[float, float]
    kx: float
    ky: float
    phase: float


@dataclass(frozen=True)
class Truth:
    """What the measurements follow from, rounded as truth.json has it.

    Parameters
    ----------
    orientations : by photo, X0 Y0 Z0 (m) OMEGA PHI KAPPA (degrees)
    prints : by photo, x and y (mm) of its centre on the sheet, and its turn (degrees)
    ripples : by template
    points : by name, X Y Z (m)
    """

    orientations: Mapping[str, Array]
    prints: Mapping[str, Array]
    ripples: Mapping[str, Sequence[Ripple]]
    points: Mapping[str, Array]


def draw_truth(random: np.random.RandomState, project: Project) -> Truth:
    """Draw what chance decides: hand-held orientations, prints, film deformation, and where the tie points are."""
    orientations = {}
    for model in project["bundle"][0]["model"]:
        for photo, number in ((model["left"], model["column"] - 1), (model["right"], model["column"])):
            if photo not in orientations:
                planned = np.array([FIRST_X0 + BASE * number, *STRIPS[model["row"]], 0.0, 0.0])
                orientations[photo] = np.round(planned + random.normal(size=6) * OFF_PLAN, 4)
    prints, ripples = {}, {}
    for template in project["template"]:
        for photo, slot in zip(template["photos"], SLOTS, strict=True):
            prints[photo] = np.round([*slot, 0.0] + random.normal(size=3) * [0.6, 0.6, 1.0], 4)
        ripples[template["name"]] = [draw_ripple(random) for _ in range(RIPPLES)]
    points = {name: np.round([X, cliff(X, Z), Z], 4) for name, (X, Z) in TARGETS.items()}
    grid = [(X, Z) for X in np.arange(*TIES_X) for Z in np.arange(*TIES_Z)]
    for number, (X, Z) in enumerate(grid + random.uniform(-4.0, 4.0, size=(len(grid), 2))):
        points[f"tie {number}"] = np.round([X, cliff(X, Z) + 0.5 * random.normal(), Z], 4)
    return Truth(orientations, prints, ripples, points)


def draw_ripple(random: np.random.RandomState) -> Ripple:
    """Draw a wave of any direction and phase."""
    swing, direction, phase = random.uniform(0, 2 * np.pi, size=3)
    kx, ky = 2 * np.pi / random.uniform(*RIPPLE_LENGTH_MM) * np.array([np.cos(direction), np.sin(direction)])
    ax, ay = RIPPLE_MM * np.sqrt(2) * np.array([np.cos(swing), np.sin(swing)])
    return Ripple((round(float(ax), 7), round(float(ay), 7)), *(round(float(value), 6) for value in (kx, ky, phase)))


def cliff(X: float, Z: float) -> float:
    """Return Y of the cliff face: it leans back, has buttresses and gullies, and a ledge halfway up."""
    buttresses = 5.0 * np.sin(2 * np.pi * X / 95 + 0.6) + 3.0 * np.sin(2 * np.pi * X / 43 + 2.0) * (0.4 + Z / 90)
    ledge = 3.0 * np.tanh((Z - 52.0 - 4.0 * np.sin(X / 30)) / 4.0)
    return float(3.0 + 0.16 * Z + buttresses + ledge)


# ------------------------------------------------------------------------------------- ground -> photo -> film -> plate


def photo_coordinates(orientation: Array, ground: Array) -> Array:
    """Return the images (n, 2), mm in the fiducial system, of ground points (n, 3); NaN of those behind the camera."""
    R = Rotation.from_euler("XYZ", orientation[3:], degrees=True).as_matrix()
    U = (ground - orientation[:3]) @ R
    ideal = -CAMERA["C"] * U[:, :2] / np.where(U[:, 2:] < 0, U[:, 2:], np.nan)
    r2 = np.sum(ideal**2, axis=1, keepdims=True)
    return np.asarray([CAMERA["DX"], CAMERA["DY"]] + ideal * (1 + CAMERA["A3"] * r2 + CAMERA["A5"] * r2**2))


def on_sheet(place: Array, photo: Array) -> Array:
    """Return template coordinates (n, 2) of what is printed at `place`."""
    return np.asarray(place[:2] + turned(photo, place[2]))


def on_film(scale: Sequence[float], ripples: Iterable[Ripple], sheet: Array) -> Array:
    """Return where the points (n, 2) of a sheet have come to as the film deformed."""
    film = sheet * np.array(scale)
    for ripple in ripples:
        film = film + np.outer(np.sin(sheet @ [ripple.kx, ripple.ky] + ripple.phase), ripple.amplitude)
    return np.asarray(film)


def on_plate(mounting: tuple[float, float, float], film: Array) -> Array:
    """Return plate coordinates (n, 2) of points of a film."""
    return np.asarray(np.array(mounting[:2]) + turned(film, mounting[2]))


def turned(coordinates: Array, degrees: float) -> Array:
    """Return points (n, 2) turned counter-clockwise about the origin."""
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return np.asarray(coordinates @ np.array([[c, s], [-s, c]]))
