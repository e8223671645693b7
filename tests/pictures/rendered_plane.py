"""Photos of a textured plane, rendered with known truth: perspective, blur and noise."""

from __future__ import annotations

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter, map_coordinates, spline_filter
from scipy.spatial.transform import Rotation

SUPERSAMPLING = 2


def project_text(side: int, precision: str, further: str = "") -> str:
    """Return the orip.toml of a project of such photos, of so many pixels a side, without the photos."""
    return f"""\
[project]
name = "plane"

[[camera]]
name = "C"
c = 20.0
sensor = {{ columns = {side}, rows = {side}, width = 20.0, height = 20.0 }}

[[bundle]]
name = "MAIN"
measurement_precision = "{precision}"
{further}"""


class RenderedPlane(Struct, frozen=True):
    """Photos (grey values) and the homographies from the plane (texels) to their pixels, corner convention."""

    photos: list[NDArray[np.uint8]]
    homographies: list[NDArray[np.float64]]

    def partials(self, photo: int, place: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the partials (2, 2) of pixels by the coordinates of a place of the plane."""
        steps = np.array([[0.5, 0.0], [-0.5, 0.0], [0.0, 0.5], [0.0, -0.5]])
        right, left, down, up = self.pixels(photo, place + steps)
        return np.column_stack([right - left, down - up])

    def pixels(self, photo: int, places: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return where places (n, 2) of the plane are in a photo."""
        return mapped(self.homographies[photo], places)


def mapped(homography: NDArray[np.float64], places: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return places (n, 2) under a homography."""
    found = np.column_stack([places, np.ones(len(places))]) @ homography.T
    return found[:, :2] / found[:, 2:]


def texture(size: int, rng: np.random.Generator) -> NDArray[np.float64]:
    """Return grey values with detail of all sizes from three texels on."""
    found = np.zeros((size, size))
    for width in (1.6, 3.0, 6.0, 14.0):
        part = gaussian_filter(rng.standard_normal((size, size)), width, mode="wrap")
        found += part / part.std() * width**0.3
    return 120.0 + 35.0 * found / found.std()


def _homography(
    size: int, side: int, rng: np.random.Generator, turn: float, tilt: float, focal: float
) -> NDArray[np.float64]:
    """Return a camera's view of the plane of `size` texels in a photo of `side` pixels: about one texel a pixel.

    The principal distance is `focal` times `side` pixels, the principal point the middle.
    """
    kappa, (omega, phi) = rng.uniform(-turn, turn), rng.uniform(-tilt, tilt, 2)
    rotation = Rotation.from_euler("zxy", [kappa, omega, phi]).as_matrix()
    height = focal * side * rng.uniform(0.9, 1.15)
    middle = np.array([size / 2, size / 2, 0.0])
    middle[:2] += rng.uniform(-0.08, 0.08, 2) * side
    centre = middle - height * rotation[2]  # the camera looks at the middle
    camera = np.array([[focal * side, 0.0, side / 2], [0.0, focal * side, side / 2], [0.0, 0.0, 1.0]])
    return camera @ np.column_stack([rotation[:, :2], -rotation @ centre])


def render(
    count: int,
    side: int,
    rng: np.random.Generator,
    noise: float = 2.0,
    blur: float = 0.6,
    turn: float = 0.4,
    focal: float = 1.0,
) -> RenderedPlane:
    """Return photos of `side` pixels; noise in grey values, blur in pixels, turned by up to `turn` radians.

    The principal distance is `focal` times `side`.
    """
    size = int(1.4 * side)
    coefficients = spline_filter(texture(size, rng), order=3, mode="grid-wrap")
    views = [_homography(size, side, rng, turn, 0.25, focal) for _ in range(count)]
    fine = (np.arange(side * SUPERSAMPLING) + 0.5) / SUPERSAMPLING
    column, row = np.meshgrid(fine, fine)
    places = np.column_stack([column.ravel(), row.ravel()])
    photos = []
    for view in views:
        x, y = mapped(np.linalg.inv(view), places).T - 0.5  # the first texel's centre is at 0.5, 0.5
        grey = map_coordinates(coefficients, [y, x], order=3, prefilter=False, mode="grid-wrap")
        grey = gaussian_filter(grey.reshape(column.shape), blur * SUPERSAMPLING)
        grey = grey.reshape(side, SUPERSAMPLING, side, SUPERSAMPLING).mean(axis=(1, 3))
        gain, offset = rng.uniform(0.8, 1.1), rng.uniform(-10.0, 10.0)
        grey = gain * grey + offset + noise * rng.standard_normal(grey.shape)
        photos.append(np.clip(np.rint(grey), 0, 255).astype(np.uint8))
    return RenderedPlane(photos, views)
