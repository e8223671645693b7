"""Images as tiles of several levels, made when they are asked for, and kept in a folder of the project."""

from __future__ import annotations

import hashlib
import threading
from collections import OrderedDict
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from orip.errors import InputError
from orip.files.text.atomic import remove_leftovers, replace_bytes
from orip.files.text.own_files import make_folder
from orip.files.text.regular_file import regular_bytes
from orip.images.image_files import (
    REDUCTIONS,
    in_eight_bits,
    jpeg_of,
    read_colours,
    read_eight_bits,
    read_grey,
    read_header,
)

TILE_FOLDER = ".orip-tiles"
"""In the project folder; it may be deleted at any time."""

TILE = 512
"""Pixels of a side."""

KEPT_BYTES = 160 << 20
"""Of decoded levels in memory: one of 24 megapixels in colour has 72 MB, and decoding takes as much once more."""
_QUALITY = 92
_FORMAT = "1"


class TileName(Struct, frozen=True):
    """A tile: level k is reduced by 2^k, and columns and rows count tiles."""

    level: int
    column: int
    row: int


def level_count(columns: int, rows: int) -> int:
    """Return the number of levels of an image: the last one is a single tile."""
    return max(0, (max(columns, rows, TILE) - 1).bit_length() - (TILE - 1).bit_length()) + 1


class TileStore:
    """Tiles and grey values of image files; may be used by several threads, of which one decodes at a time.

    Parameters
    ----------
    folder : Path
        Of the project. Where nothing can be written to it, tiles are made again each time.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder / TILE_FOLDER
        self._decoded: OrderedDict[str, NDArray[np.uint8]] = OrderedDict()
        self._lock = threading.Lock()
        with suppress(OSError):
            make_folder(self._folder)
            remove_leftovers(self._folder)

    def tile(self, image: Path, shown: str, name: TileName) -> bytes:
        """Return a tile as JPEG.

        Raises
        ------
        InputError
            If the image cannot be read, or has no such tile.
        """
        key = _key(image, shown)
        path = self._folder / f"{key}-{name.level}-{name.column}-{name.row}.jpg"
        with suppress(OSError):
            return regular_bytes(path)
        level = self.level(image, shown, name.level)
        rows, columns = (slice(at * TILE, (at + 1) * TILE) for at in (name.row, name.column))
        part = level[rows, columns] if min(name.row, name.column) >= 0 else level[:0]
        if not part.size:
            message = f"the image has no tile {name.column}, {name.row} in level {name.level}"
            raise InputError.single(message, shown)
        data = as_jpeg(part)
        with suppress(OSError):
            replace_bytes(path, data)
        return data

    def level(self, image: Path, shown: str, level: int, *, is_grey: bool = False) -> NDArray[np.uint8]:
        """Return an image reduced by 2^level, (rows, columns) of grey values or with three colours.

        Raises
        ------
        InputError
            If the image cannot be read, or has no such level.
        """
        with self._lock:
            key = f"{_key(image, shown)} {level}{' grey' * is_grey}"
            return self._kept(key, lambda: _read_level(image, level, shown, is_grey=is_grey))

    def grey(self, image: Path, shown: str) -> NDArray[np.uint8]:
        """Return the grey values of an image, (rows, columns), of 8 bits.

        Raises
        ------
        InputError
            If the image cannot be read.
        """
        key = _key(image, shown)
        with self._lock:
            return self._kept(f"{key} grey", lambda: read_eight_bits(image, shown))

    def _kept(self, key: str, read: Callable[[], NDArray[np.uint8]]) -> NDArray[np.uint8]:
        if key in self._decoded:
            self._decoded.move_to_end(key)
            return self._decoded[key]
        found = read()
        self._decoded[key] = found
        while len(self._decoded) > 1 and sum(one.nbytes for one in self._decoded.values()) > KEPT_BYTES:
            self._decoded.popitem(last=False)
        return found


def _key(image: Path, shown: str) -> str:
    """Return a digest of an image's path, size and time: an image that has changed has another one."""
    try:
        state = image.stat()
    except OSError as error:
        message = f"the image is not there any more ({error.strerror}); put it back, or correct 'image' in orip.toml"
        raise InputError.single(message, shown) from None
    text = f"{_FORMAT} {image.resolve()} {state.st_size} {state.st_mtime_ns}"
    return hashlib.blake2b(text.encode(errors="surrogateescape"), digest_size=12).hexdigest()


def _read_level(image: Path, level: int, shown: str, *, is_grey: bool) -> NDArray[np.uint8]:
    header = read_header(image, shown)
    if not 0 <= level < level_count(header.columns, header.rows):
        message = f"the image has no level {level}"
        raise InputError.single(message, shown)
    reduction = min(1 << level, REDUCTIONS[-1])
    if is_grey or header.bits == 16 or header.channels == 1:
        found = in_eight_bits(read_grey(image, None, reduction, shown))
    else:
        found = read_colours(image, reduction, shown)
    for _ in range(level - (reduction.bit_length() - 1)):
        found = _halved(found)
    return found


def _halved(pixels: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return means of four pixels; an odd last row or column is repeated."""
    edges = [(0, pixels.shape[0] % 2), (0, pixels.shape[1] % 2), *([(0, 0)] * (pixels.ndim - 2))]
    even = np.pad(pixels, edges, mode="edge").astype(np.uint16)
    total = even[::2, ::2] + even[1::2, ::2] + even[::2, 1::2] + even[1::2, 1::2]
    found: NDArray[np.uint8] = ((total + 2) // 4).astype(np.uint8)
    return found


def as_jpeg(pixels: NDArray[np.uint8]) -> bytes:
    """Return grey values or colours as JPEG."""
    return jpeg_of(pixels, quality=_QUALITY, subsampling=0)
