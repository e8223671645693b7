"""A model whose two photos are rectified to its axes: which place of a rectified photo is which of its image.

A rectified photo is what the photo would be with the model's axes as its own, with the mean principal distance of both
and without distortion (`orip.geometry.stereo`). Its pixels have one size in both photos, that of the images in their
middles; columns run along the base, rows against y, and a row of the left one is the same row of the right one.

What is measured in an image stands in logs as its log coordinates: pixels of a digital frame or a scan.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from msgspec import Struct

from orip.arrays import FloatArray
from orip.geometry.plane import PlaneTransformation
from orip.geometry.stereo import ray_of_rectified, rectified
from orip.multimodel.oriented_block import ModelLoop
from orip.multimodel.photo_loop import DrivenPhoto
from orip.multimodel.state import Position

_BORDER_PLACES = 33
"""Along each side of an image."""

_WIDEST = 4.0
"""Principal distances from the foot of the model's z axis up to which a photo is rectified: 76 degrees."""

_MOST_SIDES = 3.0
"""A rectified photo is not larger than so many sides of its image: one that is seen at a low angle is cut off."""


class ImageOnPlate(NamedTuple):
    """An image: from log coordinates to its plate, and its extent in log coordinates (first x and y, last x and y)."""

    to_plate: PlaneTransformation
    extent: tuple[float, float, float, float]


class RectifiedModel(Struct, frozen=True, eq=False):
    """A model with rectified photos.

    Parameters
    ----------
    images : tuple (left, right) of ImageOnPlate
    c : float
        Mean principal distance, mm.
    pitch : float
        Size of a rectified pixel, mm.
    first : tuple (left, right)
        x of the first column's outer edge, mm.
    top : float
        y of the first row's outer edge, mm.
    columns : tuple (left, right) of int
    rows : int
        0 where the two photos have no rows in common.
    """

    model: ModelLoop
    images: tuple[ImageOnPlate, ImageOnPlate]
    c: float
    pitch: float
    first: tuple[float, float]
    top: float
    columns: tuple[int, int]
    rows: int

    def place(self, side: int, plate: Position) -> Position:
        """Return column and row of a plate position; NaN where it has none."""
        ray = self.model.photos[side].ray(*plate)
        if ray is None:
            return np.nan, np.nan
        return self._pixel(side, *rectified(self.model.axes, self.c, *ray))

    def places(self, side: int, xyz: FloatArray) -> FloatArray:
        """Return columns and rows (n, 2) of points (n, 3) of the object."""
        offset = xyz - self.model.photos[side].centre
        with np.errstate(all="ignore"):
            x, y = rectified(self.model.axes, self.c, *offset.T)
        return np.stack(self._pixel(side, x, y), axis=1)

    def plates(self, side: int, places: FloatArray) -> FloatArray:
        """Return plate positions (n, 2) of columns and rows (n, 2); NaN where the photo shows nothing."""
        columns, rows = places.T
        x, y = self.first[side] + self.pitch * columns, self.top - self.pitch * rows
        photo = self.model.photos[side]
        direction = np.stack(ray_of_rectified(self.model.axes, self.c, x, y), axis=1)
        return photo.plate_places(photo.centre + direction).plate

    def logs_of(self, side: int, places: FloatArray) -> FloatArray:
        """Return log coordinates (n, 2) of columns and rows (n, 2) of a rectified photo; NaN where nothing is shown."""
        return self.images[side].to_plate.inverse().apply(self.plates(side, places))

    def _pixel(self, side: int, x: float, y: float) -> tuple[float, float]:
        return (x - self.first[side]) / self.pitch, (self.top - y) / self.pitch


def rectified_model(model: ModelLoop, images: tuple[ImageOnPlate, ImageOnPlate]) -> RectifiedModel:
    """Rectify the photos of a model.

    Parameters
    ----------
    images : tuple (left, right) of ImageOnPlate
    """
    c = 0.5 * sum(photo.camera.principal_distance for photo in model.photos)
    pitch = min(_pixel_size(model, c, photo, image) for photo, image in zip(model.photos, images, strict=True))
    extents = [_extent(model, c, pitch, photo, image) for photo, image in zip(model.photos, images, strict=True)]
    low, high = np.swapaxes(extents, 0, 1)
    bottom, top = float(low[:, 1].max()), float(high[:, 1].min())
    across = np.ceil((high[:, 0] - low[:, 0]) / pitch)
    rows = int(max(0.0, np.ceil((top - bottom) / pitch)))
    return RectifiedModel(
        model, images, c, pitch, (float(low[0, 0]), float(low[1, 0])), top, (int(across[0]), int(across[1])), rows
    )


def _extent(
    model: ModelLoop, c: float, pitch: float, photo: DrivenPhoto, image: ImageOnPlate
) -> tuple[FloatArray, FloatArray]:
    """Return the least and largest x and y of an image in the rectified photo, mm, cut off far from its middle."""
    border, (x0, y0, x1, y1) = _border(model, c, photo, image), image.extent
    (middle,) = _rectified_logs(model, c, photo, image, [[0.5 * (x0 + x1), 0.5 * (y0 + y1)]])
    most = 0.5 * _MOST_SIDES * max(x1 - x0, y1 - y0) * pitch
    shown = border[np.isfinite(border).all(axis=1)]
    if not len(shown):  # a distortion that has no inverse out there
        shown = np.nan_to_num(middle)[None, :]
    # NaN, where the middle is not shown: nothing is cut off
    return np.fmax(shown.min(axis=0), middle - most), np.fmin(shown.max(axis=0), middle + most)


def _pixel_size(model: ModelLoop, c: float, photo: DrivenPhoto, image: ImageOnPlate) -> float:
    """Return the size, mm, that pixels in the middle of an image have in the rectified photo; in the photo if none."""
    x, y = 0.5 * (image.extent[0] + image.extent[2]), 0.5 * (image.extent[1] + image.extent[3])
    at = _rectified_logs(model, c, photo, image, [[x - 0.5, y], [x + 0.5, y], [x, y - 0.5], [x, y + 0.5]])
    (ux, uy), (vx, vy) = (at[1] - at[0]).tolist(), (at[3] - at[2]).tolist()
    size = float(np.sqrt(abs(ux * vy - uy * vx)))
    _, a1, a2, _, b1, b2 = photo.inverse
    in_photo = float(np.sqrt(abs((a1 * b2 - a2 * b1) * np.linalg.det(image.to_plate.matrix))))
    return size if np.isfinite(size) else in_photo


def _rectified_logs(
    model: ModelLoop, c: float, photo: DrivenPhoto, image: ImageOnPlate, logs: list[list[float]]
) -> FloatArray:
    """Return log coordinates (n, 2) in the rectified photo, mm; NaN where they are too wide to be rectified."""
    rays = photo.rays(image.to_plate.apply(np.array(logs))).direction
    with np.errstate(all="ignore"):
        xy = np.stack(rectified(model.axes, c, *rays.T), axis=1)
        is_near = (rays @ np.array(model.axes[2::3]) < 0.0) & (np.hypot(*xy.T) < _WIDEST * c)
    return np.where(is_near[:, None], xy, np.nan)


def _border(model: ModelLoop, c: float, photo: DrivenPhoto, image: ImageOnPlate) -> FloatArray:
    """Return the border of an image in the rectified photo (n, 2), mm; where it is too wide, as far as it may be."""
    x0, y0, x1, y1 = image.extent
    part = np.linspace(0.0, 1.0, _BORDER_PLACES)
    ends = np.zeros_like(part), np.ones_like(part)
    u, v = np.concatenate([[part, ends[0]], [part, ends[1]], [ends[0], part], [ends[1], part]], axis=1)
    logs = np.column_stack([x0 + u * (x1 - x0), y0 + v * (y1 - y0)])
    away = photo.rays(image.to_plate.apply(logs)).direction @ np.array(model.axes).reshape(3, 3)[:, :2]
    with np.errstate(all="ignore"):
        limit = away / np.linalg.norm(away, axis=1)[:, None] * _WIDEST * c
    near = _rectified_logs(model, c, photo, image, logs.tolist())
    return np.where(np.isnan(near), limit, near)
