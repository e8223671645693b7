"""Tiles of rectified photos, resampled from the images when they are asked for; nothing of them is kept."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from orip.arrays import FloatArray
from orip.errors import InputError
from orip.images.tiles import KEPT_BYTES, TILE, TileName, TileStore, as_jpeg, level_count
from orip.screen.plates import Plate

_GRID = 8
"""Pixels of a tile between the places that are computed: between them they are interpolated, 0.01 pixels off for a
photo turned by 60 degrees with a principal distance of 1000 pixels."""

_NOTHING = 34
"""Grey value beyond the image: that of the page."""

_MARGIN = 3
"""Pixels around what a tile shows: of the cubic convolution."""


def rectified_tile(
    store: TileStore,
    plate: Plate,
    size: tuple[int, int],
    name: TileName,
    pixels: Callable[[FloatArray], FloatArray],
) -> bytes:
    """Return a tile of a rectified photo as JPEG.

    Parameters
    ----------
    store : TileStore
    plate : Plate
        With the image.
    size : tuple of 2 int
        Columns and rows of the rectified photo.
    name : TileName
    pixels : function of an array (n, 2)
        From columns and rows of the rectified photo to those of the image; NaN where it shows nothing.

    Raises
    ------
    InputError
        If the image cannot be read, or there is no such tile.
    """
    reduction = 1 << name.level
    first = np.array([name.column, name.row]) * TILE
    width, height = (min(TILE, -(-full // reduction) - at) for full, at in zip(size, first.tolist(), strict=True))
    if not (0 <= name.level < level_count(*size) and min(name.column, name.row) >= 0 and min(width, height) > 0):
        message = f"the rectified photo has no tile {name.column}, {name.row} in level {name.level}"
        raise InputError.single(message, plate.shown)
    level = min(name.level, level_count(*plate.size) - 1)
    # two photos in colour that are not in memory together would be decoded again and again
    is_grey = 2 * 3 * plate.size[0] * plate.size[1] > KEPT_BYTES
    places = _places(width, height, lambda grid: pixels((grid + first) * reduction) / (1 << level))
    with store.level(plate.stored, level, is_grey=is_grey) as image:
        found = _resampled(image, places)
    return as_jpeg(found)


def _places(width: int, height: int, of: Callable[[FloatArray], FloatArray]) -> FloatArray:
    """Return columns and rows (2, height, width) at the middles of a tile's pixels, interpolated; NaN for nothing."""
    columns, rows = (np.arange(-(-side // _GRID) + 1) * float(_GRID) for side in (width, height))
    grid = np.stack(np.meshgrid(columns, rows), axis=-1)
    found = of(grid.reshape(-1, 2)).reshape(grid.shape)
    return np.stack([_interpolated(np.ascontiguousarray(found[..., part]))[:height, :width] for part in (0, 1)])


def _interpolated(grid: FloatArray) -> FloatArray:
    """Return values in the middles of `_GRID` x `_GRID` pixels of each mesh, bilinear: (8 n, 8 m) of (n + 1, m + 1)."""
    part = (np.arange(_GRID) + 0.5) / _GRID
    down = grid[:-1, None, :] * (1.0 - part)[:, None] + grid[1:, None, :] * part[:, None]
    down = down.reshape(-1, grid.shape[1], 1)
    return np.asarray(down[:, :-1] * (1.0 - part) + down[:, 1:] * part).reshape(len(down), -1)


def _resampled(image: NDArray[np.uint8], places: FloatArray) -> NDArray[np.uint8]:
    """Return an image at columns and rows (2, height, width), by cubic convolution."""
    import cv2

    known = np.ones(places.shape[1:], dtype=bool)
    with np.errstate(invalid="ignore"):
        for at, limit in zip(places, image.shape[1::-1], strict=True):
            known &= (at > -_MARGIN) & (at < limit + _MARGIN)
    if not known.any():
        return np.full((*known.shape, *image.shape[2:]), _NOTHING, dtype=np.uint8)
    # OpenCV takes no more than 32767 columns: the part that is shown
    (left, right), (upper, lower) = (
        (max(int(at[known].min()) - _MARGIN, 0), int(at[known].max()) + _MARGIN + 1) for at in places
    )
    part = np.ascontiguousarray(image[upper:lower, left:right])
    # from outer corners to the middles of pixels, from which OpenCV counts
    columns, rows = (
        np.where(known, at - first - 0.5, -1e4).astype(np.float32)
        for at, first in zip(places, (left, upper), strict=True)
    )
    found: Any = cv2.remap(
        part, columns, rows, cv2.INTER_CUBIC, borderMode=cv2.BORDER_CONSTANT, borderValue=(_NOTHING,) * 3
    )
    return np.asarray(found, dtype=np.uint8)
