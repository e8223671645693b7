"""Photos of a hilly surface, rendered with known truth: a strip of tilted photos with distortion, and its project.

What the rest of a test compares with is computed here by scipy's rotations and the polynomial of docs/conventions.md.
"""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
from msgspec import Struct
from pictures.rendered_plane import texture
from scipy.interpolate import RectBivariateSpline
from scipy.ndimage import gaussian_filter, map_coordinates
from scipy.spatial.transform import Rotation

COLUMNS, ROWS, PIXEL, C = 480, 400, 0.02, 10.0
A3, P1 = 4e-4, 1e-4
"""Half a millimetre too little in the corners: some five pixels."""

HEIGHT, BASE, PHOTOS, AZIMUTH = 100.0, 32.0, 4, 30.0
"""m; a pixel is 0.2 m on the ground, neighbours share two thirds; degrees from X to the flight's direction."""

NOISE = 0.2
"""Pixels: of what is measured in the project."""

CONTROL = 0.02
"""m: error of the coordinates of control points."""

_TEXEL = 0.15
_SIDE = 1200
_FINE = 2
"""Rays a pixel along each side."""

MODELS = [(f"M{n + 1}", f"P{n}", f"P{n + 1}", 1, n + 1) for n in range(PHOTOS - 1)]


def height(x, y):
    """Return the height of the surface."""
    return 5.0 * np.sin(x / 17.0) * np.cos(y / 13.0) + 0.04 * x + 10.0


class RenderedStrip(Struct, frozen=True):
    """The photos (grey values), their projection centres, and their rotations from photo to ground."""

    photos: list[np.ndarray]
    centres: np.ndarray
    rotations: list[np.ndarray]

    def pixels(self, photo: int, xyz: np.ndarray) -> np.ndarray:
        """Return columns and rows (n, 2) of points (n, 3)."""
        u = (np.atleast_2d(xyz) - self.centres[photo]) @ self.rotations[photo]
        x, y = (-C * u[:, :2] / u[:, 2:]).T
        square = x * x + y * y
        dx, dy = x * A3 * square + P1 * (square + 2 * x * x), y * A3 * square + 2 * P1 * x * y
        return np.column_stack([COLUMNS / 2 + (x + dx) / PIXEL, ROWS / 2 - (y + dy) / PIXEL])

    def shows(self, photo: int, xyz: np.ndarray, margin: float = 8.0) -> np.ndarray:
        """Tell which points (n, 3) a photo shows, off its border by a margin in pixels."""
        at = self.pixels(photo, xyz)
        return ((at > margin) & (at < np.array([COLUMNS, ROWS]) - margin)).all(axis=1)

    def surface(self, photo: int, pixels: np.ndarray) -> np.ndarray:
        """Return the points (n, 3) of the surface that a photo shows at columns and rows (n, 2)."""
        xy = (pixels - (COLUMNS / 2, ROWS / 2)) * (PIXEL, -PIXEL)
        ideal = xy.copy()
        for _ in range(12):  # the distortion is small: a fixed point
            x, y = ideal.T
            square = x * x + y * y
            ideal = xy - np.column_stack(
                [x * A3 * square + P1 * (square + 2 * x * x), y * A3 * square + 2 * P1 * x * y]
            )
        rays = np.column_stack([ideal, np.full(len(ideal), -C)]) @ self.rotations[photo].T
        x0, y0, z0 = self.centres[photo]
        z = np.full(len(rays), 10.0)
        for _ in range(25):  # rays are steep, slopes are not
            x, y = x0 + rays[:, 0] * (z - z0) / rays[:, 2], y0 + rays[:, 1] * (z - z0) / rays[:, 2]
            z = height(x, y)
        return np.column_stack([x, y, z])


def render_strip(seed: int = 5, noise: float = 1.5) -> RenderedStrip:
    """Return the photos of a strip; noise in grey values."""
    random = np.random.default_rng(seed)
    field = texture(_SIDE, random)
    along = np.array([np.cos(np.radians(AZIMUTH)), np.sin(np.radians(AZIMUTH))])
    centres = np.array([[*(n * BASE * along), HEIGHT] for n in range(PHOTOS)]) + random.normal(size=(PHOTOS, 3))
    angles = random.normal(size=(PHOTOS, 3)) * [3.0, 3.0, 6.0] + [0.0, 0.0, AZIMUTH]
    rotations = [Rotation.from_euler("XYZ", one, degrees=True).as_matrix() for one in angles]
    strip = RenderedStrip([], centres, rotations)
    for photo in range(PHOTOS):
        x, y = _seen(strip, photo)
        grey = map_coordinates(field, [y / _TEXEL, x / _TEXEL], order=1, prefilter=False, mode="grid-wrap")
        grey = gaussian_filter(grey, 0.6 * _FINE)
        grey = grey.reshape(ROWS, _FINE, COLUMNS, _FINE).mean(axis=(1, 3)) * random.uniform(0.9, 1.1)
        grey += noise * random.standard_normal(grey.shape)
        strip.photos.append(np.clip(np.rint(grey), 0, 255).astype(np.uint8))
    return strip


def _seen(strip: RenderedStrip, photo: int) -> list[np.ndarray]:
    """Return X and Y of what a photo shows at all rays, by splines through those of every eighth pixel."""
    coarse = [np.arange(-8.0, side + 9.0, 8.0) for side in (COLUMNS, ROWS)]
    fine = [(np.arange(side * _FINE) + 0.5) / _FINE for side in (COLUMNS, ROWS)]
    places = np.stack(np.meshgrid(*coarse), axis=-1)
    xyz = strip.surface(photo, places.reshape(-1, 2)).reshape(*places.shape[:2], 3)
    return [RectBivariateSpline(coarse[1], coarse[0], xyz[..., part])(fine[1], fine[0]) for part in (0, 1)]


def ground_points(strip: RenderedStrip, count: int, random: np.random.Generator) -> np.ndarray:
    """Return points (count, 3) of the surface that both photos of a model show."""
    found = []
    while len(found) < count:
        x, y = strip.centres[:, :2].min(axis=0) + random.uniform(-45.0, 45.0 + BASE * PHOTOS, 2)
        xyz = np.array([x, y, height(x, y)])
        shown = [bool(strip.shows(photo, xyz)[0]) for photo in range(PHOTOS)]
        if any(one and other for one, other in pairwise(shown)):
            found.append(xyz)
    return np.array(found)


_DIGITAL = f"sensor = {{ columns = {COLUMNS}, rows = {ROWS}, width = {COLUMNS * PIXEL}, height = {ROWS * PIXEL} }}"
_MARKS = {"1": (-4.0, -3.0), "2": (4.0, -3.0), "3": (4.0, 3.0), "4": (-4.0, 3.0)}
_FILM = f"frame = [{COLUMNS * PIXEL}, {ROWS * PIXEL}]\nfiducials = [" + ", ".join(
    f'{{ name = "{name}", x = {x}, y = {y} }}' for name, (x, y) in _MARKS.items()
) + "]"  # fmt: skip
_SCAN = f'scan = {{ pixel = {PIXEL}, origin = "centre" }}'


def write_strip(folder: Path, strip: RenderedStrip, *, models: bool = True, is_film: bool = False) -> Path:
    """Write the project of a strip: images, control and tie points, measured with noise in pixels.

    As film the photos have fiducial marks, and are measured in scans, from the middle of the upper left pixel.
    """
    from PIL import Image

    random = np.random.default_rng(17)
    control, ties = ground_points(strip, 12, random), ground_points(strip, 80, random)
    names = {f"C{n}": xyz for n, xyz in enumerate(control)} | {f"T{n}": xyz for n, xyz in enumerate(ties)}
    (folder / "images").mkdir(parents=True)
    toml = f"""\
project = {{ name = "hills" }}
[[camera]]
name = "C"
c = {C}
{_FILM if is_film else _DIGITAL}
distortion = {{ A3 = {A3}, P1 = {P1} }}
"""
    log, origin = "", 0.5 if is_film else 0.0
    for photo, grey in enumerate(strip.photos):
        Image.fromarray(grey).save(folder / "images" / f"P{photo}.png")
        toml += f'[[photo]]\nname = "P{photo}"\ncamera = "C"\nimage = "images/P{photo}.png"\n{_SCAN * is_film}\n'
        if is_film:
            log += f"PHOTO P{photo} A\n"
            for name, (x, y) in _MARKS.items():
                log += f"  {name} {COLUMNS / 2 + x / PIXEL - origin:.4f} {ROWS / 2 - y / PIXEL - origin:.4f}\n"
        log += f"POINTS MAIN P{photo}\n"
        for name, xyz in names.items():
            if strip.shows(photo, xyz)[0]:
                x, y = strip.pixels(photo, xyz)[0] - origin + NOISE * random.normal(size=2)
                log += f"  {name} {x:.4f} {y:.4f}\n"
    toml += f'[[bundle]]\nname = "MAIN"\nmeasurement_precision = "{NOISE}px"\n'
    for name, left, right, row, column in MODELS if models else ():
        toml += (
            f'[[bundle.model]]\nname = "{name}"\nleft = "{left}"\nright = "{right}"\nrow = {row}\ncolumn = {column}\n'
        )
    given = {name: xyz + CONTROL * random.normal(size=3) for name, xyz in names.items() if name[0] == "C"}
    lines = (f"{name} {x:.4f} {y:.4f} {z:.4f} {CONTROL} {CONTROL} {CONTROL}\n" for name, (x, y, z) in given.items())
    (folder / "orip.toml").write_text(toml, encoding="utf-8")
    (folder / "hills.MEA").write_text(log, encoding="utf-8")
    (folder / "hills.PNT").write_text("".join(lines), encoding="utf-8")
    return folder
