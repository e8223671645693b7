"""The images that lie on the plates: of each photo the file, its size, and how its pixels are measured.

Of rectified photos tiles are resampled when they are asked for, and nothing is kept.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from orip.arrays import FloatArray
from orip.errors import InputError, UsageError
from orip.files.text.regular_file import is_there
from orip.images.images_of_photos import image_fault, origin_of_pixels, paths_of_photos
from orip.images.tiles import KEPT_BYTES, TILE, StoredImage, TileName, TileStore, as_jpeg, level_count
from orip.records.names import record_key
from orip.workflow.project.state import ProjectState


class Plate(Struct, frozen=True):
    """The image of a photo.

    Parameters
    ----------
    photo : str
    image : Path or None
        None where there is none.
    shown : str
        The file as the user would name it.
    size : tuple of 2 int
        Columns and rows.
    origin : float
        What measured coordinates are less than columns and rows from the outer corner of the upper left pixel.
    fault : str
        Why nothing can be measured in it; empty: it can.
    """

    photo: str
    image: Path | None
    shown: str
    size: tuple[int, int]
    origin: float
    fault: str

    @property
    def stored(self) -> StoredImage:
        """Return the image; there is one."""
        assert self.image is not None, "it has no fault"
        return StoredImage(self.image, self.shown, self.size)

    def to_log(self, pixel: tuple[float, float]) -> tuple[float, float]:
        """Return the coordinates of a measurement file of a place in pixels."""
        return pixel[0] - self.origin, pixel[1] - self.origin

    def to_pixel(self, log: tuple[float, float]) -> tuple[float, float]:
        """Return the place in pixels of coordinates of a measurement file."""
        return log[0] + self.origin, log[1] + self.origin


def plates_of(state: ProjectState, images: Path | None) -> dict[str, Plate]:
    """Return the plates of all photos of a project by their names.

    Parameters
    ----------
    state : ProjectState
        With definitions.
    images : Path or None
        Folder of images that the project does not name; None: that of the project.

    Raises
    ------
    InputError
        If a photo has several images.
    UsageError
        If no photo has an image that can be measured in, or Pillow or OpenCV is not installed.
    """
    _require_packages()
    records, folder = state.records, state.project.folder
    paths, complaints = paths_of_photos({photo.name: photo.image for photo in records.photos.values()}, folder, images)
    if complaints:
        raise InputError(complaints)
    found: dict[str, Plate] = {}
    for photo in records.photos.values():
        camera, template = records.cameras.get(record_key(photo.camera)), records.template_of(photo)
        origin = origin_of_pixels(camera, photo.scan or (None if template is None else template.scan))
        sensor = None if camera is None else camera.sensor
        path = paths.get(photo.name)
        if path is None:
            size, fault = None, "no image of this photo was found: name it with image = in orip.toml"
        elif not is_there(path):
            size, fault = (
                None,
                f"its image {state.project.shown(path)} is missing: put it there, or correct image in orip.toml",
            )
        else:
            size, fault = image_fault(path, None if sensor is None else (sensor.columns, sensor.rows))
        if origin is None:
            fault = "it is measured in millimetres: give its camera a sensor, or the photo a scan"
        shown = "" if path is None else state.project.shown(path)
        found[photo.name] = Plate(photo.name, path, shown, size or (0, 0), origin or 0.0, fault)
    _require_one(found)
    return found


def _require_one(plates: Mapping[str, Plate]) -> None:
    if all(plate.fault for plate in plates.values()):
        faults = "".join(f"\n  photo {plate.photo}: {plate.fault}" for plate in list(plates.values())[:5])
        message = (
            "no photo has an image that can be measured in: name it with image = in orip.toml, or put images named as "
            f"the photos into the project folder, or into one given with --images{faults}"
        )
        raise UsageError(message)


def _require_packages() -> None:
    try:
        import cv2  # noqa: F401
        import PIL  # noqa: F401
    except ImportError as error:
        message = f"images need the package {error.name}, which is not installed: pip install 'orip[images]'"
        raise UsageError(message) from error


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
    plate : Plate
        With the image.
    size : tuple of 2 int
        Columns and rows of the rectified photo.
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
