"""The pictures of the project, rendered: P1.png to P4.png. Needs numpy, scipy and Pillow.

    python simulate.py          writes the pictures
    python simulate.py texts    writes HILL.MEA, HILL.PNT and truth.json, as they are here

What is here is independent of orip: rotations by scipy, collinearity as in docs/conventions.md, no distortion.
"""

import json
import sys
from pathlib import Path

import numpy as np
from scipy.interpolate import RectBivariateSpline
from scipy.ndimage import gaussian_filter, map_coordinates
from scipy.spatial.transform import Rotation

FOLDER = Path(__file__).parent
COLUMNS, ROWS, PIXEL, C = 900, 700, 0.01, 9.0  # pixels, mm
FINE = 2  # rays a pixel, along each side
PHOTOS = {
    "P1": ((0.4, -0.8, 100.3), (1.2, -0.7, 2.0)),
    "P2": ((30.2, 0.9, 99.6), (-0.9, 1.1, -1.5)),
    "P3": ((59.5, -0.3, 100.1), (0.5, 0.8, 3.1)),
    "P4": ((90.6, 0.5, 99.8), (-1.4, -0.4, 0.6)),
}  # X0 Y0 Z0 in m, omega phi kappa in degrees
CONTROL = {"C1": (-8, 22), "C2": (-6, -24), "C3": (45, 26), "C4": (46, -25), "C5": (97, 21), "C6": (95, -22)}
CONTROL_ERROR, MEASURED_ERROR = 0.01, 0.2  # m, pixels
TEXEL, ORIGIN, SIZE = 0.08, (-70.0, -65.0), (2900, 1700)  # m, m, columns and rows of what lies on the ground


def height(x, y):
    """Return the height of the ground: a long hill with some waves on it."""
    hill = 9.0 * np.exp(-(((x - 45.0) / 32.0) ** 2) - (y / 13.0) ** 2)
    return 10.0 + hill + 0.5 * np.sin(x / 6.0) * np.cos(y / 7.0)


def rotation(name):
    """Return the rotation from photo to ground."""
    return Rotation.from_euler("XYZ", PHOTOS[name][1], degrees=True).as_matrix()


def pixels(name, xyz):
    """Return columns and rows (n, 2) of points (n, 3)."""
    u = (xyz - np.array(PHOTOS[name][0])) @ rotation(name)
    return np.column_stack([COLUMNS / 2 - C * u[:, 0] / u[:, 2] / PIXEL, ROWS / 2 + C * u[:, 1] / u[:, 2] / PIXEL])


def shown_ground(name, columns, rows):
    """Return X and Y of the ground at columns and rows."""
    rays = np.stack([(columns - COLUMNS / 2) * PIXEL, (ROWS / 2 - rows) * PIXEL, np.full(columns.shape, -C)], axis=-1)
    rays = rays @ rotation(name).T
    x0, y0, z0 = PHOTOS[name][0]
    z = np.full(columns.shape, 10.0)
    for _ in range(40):  # the rays are steeper than the slopes
        along = (z - z0) / rays[..., 2]
        x, y = x0 + rays[..., 0] * along, y0 + rays[..., 1] * along
        z = height(x, y)
    return x, y


def texture(random):
    """Return grey values of the ground: grain of four sizes."""
    found = np.zeros(SIZE[::-1])
    for size in (1.2, 4.0, 14.0, 60.0):
        grain = gaussian_filter(random.standard_normal(found.shape), size, mode="wrap")
        found += grain / grain.std() * size**0.15
    return 125.0 + 32.0 * found / found.std()


def render():
    """Write the pictures."""
    from PIL import Image

    random = np.random.default_rng(1989)
    ground = texture(random)
    coarse = np.arange(-8.0, COLUMNS + 9.0, 8.0), np.arange(-8.0, ROWS + 9.0, 8.0)
    fine = ((np.arange(side * FINE) + 0.5) / FINE for side in (COLUMNS, ROWS))
    columns, rows = fine
    for name in PHOTOS:
        x, y = (
            RectBivariateSpline(*coarse[::-1], part)(rows, columns)
            for part in shown_ground(name, *np.meshgrid(*coarse))
        )
        grey = map_coordinates(ground, [(y - ORIGIN[1]) / TEXEL, (x - ORIGIN[0]) / TEXEL], order=1, mode="grid-wrap")
        grey = grey.reshape(ROWS, FINE, COLUMNS, FINE).mean(axis=(1, 3)) + 1.5 * random.standard_normal((ROWS, COLUMNS))
        Image.fromarray(np.clip(np.rint(grey), 0, 255).astype(np.uint8)).save(FOLDER / f"{name}.png")
        print("wrote", f"{name}.png")


def write_texts():
    """Write what was measured, the control points, and the truth."""
    random = np.random.default_rng(89)
    places = {**CONTROL, **{f"T{n}": random.uniform([-12, -28], [102, 28]) for n in range(1, 61)}}
    truth = {name: (*map(float, xy), float(height(*xy))) for name, xy in places.items()}
    lines = ["! Simulated; see README.md"]
    for name in PHOTOS:
        lines.append(f"POINTS MAIN {name}")
        for point, xyz in truth.items():
            column, row = pixels(name, np.array([xyz]))[0] + MEASURED_ERROR * random.standard_normal(2)
            if 10 < column < COLUMNS - 10 and 10 < row < ROWS - 10:
                lines.append(f"  {point:<4} {column:8.2f} {row:8.2f}")
    (FOLDER / "HILL.MEA").write_text("\n".join(lines) + "\n", encoding="utf-8")
    lines = ["! Control points: name, X, Y, Z, m, and their a-priori errors"]
    for name in CONTROL:
        x, y, z = np.array(truth[name]) + CONTROL_ERROR * random.standard_normal(3)
        lines.append(f"{name}  {x:8.3f}  {y:8.3f}  {z:7.3f}  {CONTROL_ERROR} {CONTROL_ERROR} {CONTROL_ERROR}")
    (FOLDER / "HILL.PNT").write_text("\n".join(lines) + "\n", encoding="utf-8")
    rounded = {name: [round(value, 4) for value in xyz] for name, xyz in truth.items()}
    content = {"photos": {name: [*centre, *angles] for name, (centre, angles) in PHOTOS.items()}, "points": rounded}
    text = ",\n".join(f' "{key}": {json.dumps(value)}' for key, value in content.items())
    (FOLDER / "truth.json").write_text(f"{{\n{text}\n}}\n", encoding="utf-8")


if __name__ == "__main__":
    write_texts() if sys.argv[1:] == ["texts"] else render()
