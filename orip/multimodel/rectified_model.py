"""A model whose two photos are rectified to its axes: which place of a rectified photo is which of its image.

A rectified photo is what the photo would be with the model's axes as its own, with the mean principal distance of both
and without distortion (`orip.geometry.stereo`). Its pixels have one size in both photos, about that of the images;
columns run along the base, rows against y, and a row of the left one is the same row of the right one.

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
    model : ModelLoop
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
    model : ModelLoop
    images : tuple (left, right) of ImageOnPlate
    """
    c = 0.5 * sum(photo.camera.principal_distance for photo in model.photos)
    pitch = min(_pixel_size(photo, image) for photo, image in zip(model.photos, images, strict=True))
    borders = [_border(model, c, photo, image) for photo, image in zip(model.photos, images, strict=True)]
    low, high = (np.array([f(xy, axis=0) for xy in borders]) for f in (np.nanmin, np.nanmax))
    bottom, top = float(low[:, 1].max()), float(high[:, 1].min())
    sides = [_MOST_SIDES * max(one.extent[2] - one.extent[0], one.extent[3] - one.extent[1]) for one in images]
    across = [
        min(float(np.ceil((b - a) / pitch)), most) for a, b, most in zip(low[:, 0], high[:, 0], sides, strict=True)
    ]
    rows = int(max(0.0, min(np.ceil((top - bottom) / pitch), *sides)))
    return RectifiedModel(
        model, images, c, pitch, (float(low[0, 0]), float(low[1, 0])), top, (int(across[0]), int(across[1])), rows
    )


def _pixel_size(photo: DrivenPhoto, image: ImageOnPlate) -> float:
    """Return the size of an image's pixels in the photo, mm."""
    _, a1, a2, _, b1, b2 = photo.inverse
    return float(np.sqrt(abs((a1 * b2 - a2 * b1) * np.linalg.det(image.to_plate.matrix))))


def _border(model: ModelLoop, c: float, photo: DrivenPhoto, image: ImageOnPlate) -> FloatArray:
    """Return the border of an image in the rectified photo (n, 2), mm; NaN where it is too wide to be rectified."""
    x0, y0, x1, y1 = image.extent
    part = np.linspace(0.0, 1.0, _BORDER_PLACES)
    ends = np.zeros_like(part), np.ones_like(part)
    u, v = np.concatenate([[part, ends[0]], [part, ends[1]], [ends[0], part], [ends[1], part]], axis=1)
    log = np.column_stack([x0 + u * (x1 - x0), y0 + v * (y1 - y0)])
    rays = photo.rays(image.to_plate.apply(log)).direction
    z = rays @ np.array(model.axes).reshape(3, 3)[:, 2]
    with np.errstate(all="ignore"):
        xy = np.stack(rectified(model.axes, c, *rays.T), axis=1)
        wide = ~((z < 0.0) & (np.hypot(*xy.T) < _WIDEST * c))
    # beyond that the border is cut off there
    away = np.array(model.axes).reshape(3, 3)[:, :2]
    limit = rays @ away / np.linalg.norm(rays @ away, axis=1)[:, None] * _WIDEST * c
    return np.where(wide[:, None], limit, xy)
