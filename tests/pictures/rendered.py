"""Photographs of boards with known truth: rays through orip's camera, supersampled, blurred, with noise."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from msgspec import Struct

from orip.arrays import FloatArray
from orip.geometry.rotation import rotation_from_angles
from orip.interior.distortion import distorted_with_partials, remove_distortion
from orip.pictures.targets.boards import Board
from orip.pictures.targets.printing import Shape, board_shapes, board_size

PER_MM = 8
"""Samples of the drawing: sides that are multiples of 1/8 mm are exact."""


class Camera(Struct, frozen=True):
    """A digital camera: columns and rows, pixel size and principal distance in mm, nine coefficients of distortion."""

    columns: int = 900
    rows: int = 680
    pixel: float = 0.005
    c: float = 5.0
    distortion: tuple[float, ...] = (0.0, 2e-3, -3e-5, 0.0, 0.0, 5e-5, -4e-5, 0.0, 0.0)

    def project(self, xyz: FloatArray, station: Station) -> FloatArray:
        """Return pixels (n, 2) of points (n, 3)."""
        u = (xyz - station.centre) @ station.rotation
        x, y = (-self.c * u[:, :2] / u[:, 2:]).T
        x, y = distorted_with_partials(self.distortion, x, y)[:2]
        return np.stack([self.columns / 2 + x / self.pixel, self.rows / 2 - y / self.pixel], axis=1)

    def on_plane(self, pixels: FloatArray, station: Station) -> FloatArray:
        """Return X and Y of the points of the plane Z = 0 that are seen at pixels (n, 2)."""
        xy = (pixels - (self.columns / 2, self.rows / 2)) * (self.pixel, -self.pixel)
        ideal = remove_distortion(xy, np.array(self.distortion))
        rays = np.column_stack([ideal, np.full(len(ideal), -self.c)]) @ station.rotation.T
        return np.asarray(station.centre[:2] - rays[:, :2] * (station.centre[2] / rays[:, 2])[:, None])


class Station(Struct, frozen=True):
    """Where a camera is, mm, and its rotation."""

    centre: FloatArray
    rotation: FloatArray


def looking_at(board: Board, angles: Sequence[float], distance: float) -> Station:
    """Return a station that looks at the middle of a board from a distance, with omega, phi, kappa in degrees."""
    rotation = rotation_from_angles(np.radians(angles))
    width, height = board_size(board)
    return Station(np.array([width / 2, height / 2, 0.0]) + rotation[:, 2] * distance, rotation)


def drawing(shapes: Iterable[Shape], size: tuple[float, float], margin: float) -> Any:
    """Return samples of a drawing with a light margin, rows upwards, 0 dark and 1 light."""
    import cv2

    columns, rows = (round((side + 2 * margin) * PER_MM) for side in size)
    field = np.ones((rows, columns), dtype=np.float32)
    middle_x = (np.arange(columns) + 0.5) / PER_MM - margin
    middle_y = (np.arange(rows) + 0.5) / PER_MM - margin
    for shape in shapes:
        i = slice(*np.searchsorted(middle_x, (shape.x, shape.x + shape.width)))
        j = slice(*np.searchsorted(middle_y, (shape.y, shape.y + shape.height)))
        value = 0.0 if shape.is_dark else 1.0
        if shape.corners:
            corners = np.rint(((np.array(shape.corners) + margin) * PER_MM - 0.5) * 16.0).astype(np.int32)
            cv2.fillPoly(field, [corners], value, shift=4)
        elif shape.is_round:
            r = 0.5 * shape.width
            inside = np.hypot(middle_x[i] - shape.x - r, (middle_y[j] - shape.y - r)[:, None]) < r
            field[j, i] = np.where(inside, value, field[j, i])
        else:
            field[j, i] = value
    return field


def _smooth_map(camera: Camera, station: Station) -> list[Any]:
    """Return splines of X and Y of the plane by row and column: 1e-6 of a pixel off the rays of all samples."""
    from scipy.interpolate import RectBivariateSpline

    columns, rows = np.arange(-8.0, camera.columns + 9.0, 8.0), np.arange(-8.0, camera.rows + 9.0, 8.0)
    i, j = np.meshgrid(columns, rows)
    at = camera.on_plane(np.stack([i.ravel(), j.ravel()], axis=1), station)
    return [RectBivariateSpline(rows, columns, part.reshape(i.shape)) for part in at.T]


def photograph(
    field: Any, margin: float, camera: Camera, station: Station, *, blur: float = 0.7, noise: float = 2.0, seed: int = 1
) -> Any:
    """Return a picture of a drawing on a grey table, 3 x 3 samples a pixel."""
    import cv2

    times = 3
    random = np.random.default_rng(seed)
    # a sample anywhere in its cell: edges along the rows of a picture are as exact as slanting ones
    shape = camera.rows * times, camera.columns * times
    i = (np.arange(shape[1]) + 0.5) / times
    j = (np.arange(shape[0]) + 0.5) / times
    x, y = (plane(j, i) for plane in _smooth_map(camera, station))
    dx, dy = ((random.random(shape) - 0.5) / times for _ in "xy")
    step = 1.0 / times
    x, y = (a + dx * np.gradient(a, step, axis=1) + dy * np.gradient(a, step, axis=0) for a in (x, y))
    # edges of the drawing get a width of a few samples: no sampling noise beyond that which is asked for
    smooth = cv2.GaussianBlur(field, (0, 0), 1.0)
    column, row = (((a + margin) * PER_MM - 0.5).astype(np.float32) for a in (x, y))
    light = cv2.remap(smooth, column, row, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=0.45)
    light = light.reshape(camera.rows, times, camera.columns, times).mean(axis=(1, 3))
    grey = cv2.GaussianBlur(40.0 + 170.0 * light, (0, 0), blur) if blur else 40.0 + 170.0 * light
    grey = grey + random.normal(0.0, noise, grey.shape)
    return np.clip(np.rint(grey), 0, 255).astype(np.uint8)


def photograph_of(board: Board, camera: Camera, station: Station, **settings: Any) -> Any:
    """Return a picture of a board."""
    margin = board.square if board.kind != "circles" else 2 * board.square
    return photograph(drawing(board_shapes(board), board_size(board), margin), margin, camera, station, **settings)
