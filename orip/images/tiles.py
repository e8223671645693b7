"""Images as tiles of several levels, made when they are asked for and kept, up to a limit, in the project's folder."""

from __future__ import annotations

import hashlib
import threading
from collections import OrderedDict
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from pathlib import Path

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from orip.errors import InputError
from orip.files.text.atomic import remove_leftovers, replace_bytes
from orip.files.text.own_files import make_folder, remove_file
from orip.files.text.regular_file import open_regular, regular_bytes
from orip.images import TILE_FOLDER
from orip.images.image_files import (
    REDUCTIONS,
    in_eight_bits,
    jpeg_of,
    read_colours,
    read_eight_bits,
    read_grey,
    read_header,
)

MOST_BYTES = 4 << 30
"""That are kept: photos of 24 megapixels have 24 MB of grey values and some 15 MB of tiles each."""

_LEFT = 0.75
"""Part of them that stays where there are more: what was written last."""


class TileFolder:
    """Files of a folder, the oldest of which go when they are too many; one thread at a time.

    Where nothing can be written, nothing is kept.

    Parameters
    ----------
    project : Path
        The folder in which it is.
    most : int, optional
        Bytes.
    """

    def __init__(self, project: Path, most: int = MOST_BYTES) -> None:
        self._folder, self._most = project / TILE_FOLDER, most
        with suppress(OSError):
            make_folder(self._folder)
            remove_leftovers(self._folder)
        self._bytes = sum(size for _, size, _ in self._files())
        self._let_go()

    def read(self, name: str) -> bytes | None:
        """Return a file; None where there is none."""
        with suppress(OSError):
            return regular_bytes(self._folder / name)
        return None

    def rows(self, name: str, first: int, last: int, columns: int) -> NDArray[np.uint8] | None:
        """Return rows of a file of bytes, (last - first, columns) or fewer; None where there is no such file."""
        with suppress(OSError), open_regular(self._folder / name) as file:
            file.seek(first * columns)
            found = np.frombuffer(file.read((last - first) * columns), dtype=np.uint8)
            if found.size and found.size % columns == 0:
                return found.reshape(-1, columns)
        return None

    def write(self, name: str, data: bytes) -> bool:
        """Write a file; return whether that could be done."""
        try:
            replace_bytes(self._folder / name, data)
        except OSError:
            return False
        self._bytes += len(data)
        self._let_go()
        return True

    def _files(self) -> list[tuple[int, int, str]]:
        """Return time, size and name of the files."""
        found = []
        with suppress(OSError):
            for path in self._folder.iterdir():
                with suppress(OSError):
                    state = path.lstat()
                    found.append((state.st_mtime_ns, state.st_size, path.name))
        return found

    def _let_go(self) -> None:
        if self._bytes <= self._most:
            return
        there = sorted(self._files())
        self._bytes = sum(size for _, size, _ in there)
        for _, size, name in there:
            if self._bytes <= _LEFT * self._most:
                return
            with suppress(OSError):  # what is not orip's own stays
                remove_file(self._folder / name)
                self._bytes -= size


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


class StoredImage(Struct, frozen=True):
    """An image file as it was found.

    Parameters
    ----------
    path : Path
    shown : str
        The file as the user would name it.
    size : tuple of 2 int
        Columns and rows: with others, what is measured in it would be wrong.
    """

    path: Path
    shown: str
    size: tuple[int, int]


class TileStore:
    """Tiles and grey values of image files; may be used by several threads, of which one decodes at a time.

    Parameters
    ----------
    project : Path
        Its folder. Where nothing can be written to it, tiles are made again each time.

    Methods raise an `InputError` if the image cannot be read, or has another size meanwhile.
    """

    def __init__(self, project: Path) -> None:
        self._folder = TileFolder(project)
        self._decoded: OrderedDict[str, NDArray[np.uint8]] = OrderedDict()
        self._right: set[tuple[str, tuple[int, int]]] = set()
        self._shown: dict[Path, str] = {}
        self._lock = threading.Lock()
        # what a decoder gives back stays with its thread: with one for each request memory would be twice as much
        self._decoder = ThreadPoolExecutor(1, "decoder")

    def tile(self, image: StoredImage, name: TileName) -> bytes:
        """Return a tile as JPEG; raise an `InputError` also if there is no such tile."""
        key = self._key(image)
        self._shown.setdefault(image.path, key)
        file = f"{key}-{name.level}-{name.column}-{name.row}.jpg"
        if (kept := self._folder.read(file)) is not None:
            return kept
        rows, columns = (slice(at * TILE, (at + 1) * TILE) for at in (name.row, name.column))
        with self.level(image, name.level) as level:
            part = (level[rows, columns] if min(name.row, name.column) >= 0 else level[:0]).copy()
        if not part.size:
            message = f"the image has no tile {name.column}, {name.row} in level {name.level}"
            raise InputError.single(message, image.shown)
        data = as_jpeg(part)
        with self._lock:
            self._folder.write(file, data)
        return data

    @contextmanager
    def level(self, image: StoredImage, level: int, *, is_grey: bool = False) -> Iterator[NDArray[np.uint8]]:
        """Give an image reduced by 2^level, (rows, columns) of grey values or in three colours; others wait meanwhile.

        It is not to be kept: as many as there are requests would be in memory at once.
        """
        key = f"{self._key(image)} {level}{' grey' * is_grey}"
        columns, rows = image.size
        with self._lock:
            size = columns * rows * (1 if is_grey else 3) >> 2 * level
            yield self._kept(key, size, lambda: _read_level(image.path, level, image.shown, is_grey=is_grey))

    def grey(self, image: StoredImage, rows: slice, columns: slice) -> NDArray[np.uint8]:
        """Return the grey values of a part of an image, of 8 bits; the whole is decoded once, and then kept.

        Parameters
        ----------
        rows, columns : slice
            Within the image.
        """
        key = self._key(image)
        file, memory = f"{key}.grey", f"{key} grey"
        with self._lock:
            found = None if memory in self._decoded else self._folder.rows(file, rows.start, rows.stop, image.size[0])
            if found is not None:
                return found[:, columns].copy()
            whole = self._decoded.get(memory)
            if whole is None:
                self._make_room(image.size[0] * image.size[1])
                whole = self._decoder.submit(read_eight_bits, image.path, image.shown).result()
                if not self._folder.write(file, whole.tobytes()):
                    self._kept(memory, whole.nbytes, lambda: whole)
            return whole[rows, columns].copy()

    def _kept(self, key: str, size: int, read: Callable[[], NDArray[np.uint8]]) -> NDArray[np.uint8]:
        if key not in self._decoded:
            self._make_room(size)
            self._decoded[key] = self._decoder.submit(read).result()
        self._decoded.move_to_end(key)
        return self._decoded[key]

    def _make_room(self, size: int) -> None:
        """Let go of levels before others are decoded, which takes as much once more."""
        while self._decoded and size + sum(one.nbytes for one in self._decoded.values()) > KEPT_BYTES:
            self._decoded.popitem(last=False)

    def require_as_found(self, image: StoredImage) -> None:
        """Refuse an image that cannot be read, has another size meanwhile, or, once, is no longer that of its tiles."""
        key = self._key(image)
        if self._shown.setdefault(image.path, key) != key:
            self._shown[image.path] = key
            message = (
                "the image has been replaced since it was shown: load the page again, and measure in what it shows"
            )
            raise InputError.single(message, image.shown)

    def _key(self, image: StoredImage) -> str:
        """Return a digest of an image's path, size and time: an image that has changed has another one."""
        try:
            state = image.path.stat()
        except OSError as error:
            message = f"the image is not there any more ({error.strerror}); put it back, or correct 'image'"
            raise InputError.single(message, image.shown) from None
        text = f"{_FORMAT} {image.path.resolve()} {state.st_size} {state.st_mtime_ns}"
        key = hashlib.blake2b(text.encode(errors="surrogateescape"), digest_size=12).hexdigest()
        if (key, image.size) not in self._right:
            header = read_header(image.path, image.shown)
            if (header.columns, header.rows) != image.size:
                message = (
                    f"the image has {header.columns} x {header.rows} pixels now, and had {image.size[0]} x "
                    f"{image.size[1]} when the page was begun: put it back, or end 'orip screen' and begin it again"
                )
                raise InputError.single(message, image.shown)
            self._right.add((key, image.size))
        return key


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
