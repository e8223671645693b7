"""The pixels of image files: grey values of JPEG, PNG and TIFF, whole, by regions, and made smaller.

Arrays are rows x columns of the pixels **as they are stored**: nothing is turned by EXIF's orientation, so that what is
measured fits a camera that holds for all its photos however they were held.

Coordinates of pixels are those of docs/conventions.md: (column, row) from the outer corner of the upper left pixel,
whose centre is (0.5, 0.5). The grey value `grey[i, j]` is that at column j + 0.5, row i + 0.5. OpenCV counts from the
centre of that pixel: add 0.5 to both of what its functions return. In a region that begins at (first row, first column)
and is made smaller n times, column = first column + n (column in the array), the outer corner counting in both; rows
alike.
"""

from __future__ import annotations

import struct
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from io import BufferedReader, BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from orip.errors import InputError
from orip.files.image_headers import (
    FEWEST_ON_A_SIDE,
    IMAGE_ENDINGS,
    LARGEST_IMAGE_FILE,
    MOST_PIXELS,
    ImageHeader,
    TiffDirectory,
    Unreadable,
    read_header,
    tiff_directory,
)
from orip.files.text.regular_file import open_regular

__all__ = [
    "FEWEST_ON_A_SIDE", "IMAGE_ENDINGS", "MOST_PIXELS", "REDUCTIONS", "Grey", "ImageHeader", "Region", "read_colours",
    "read_eight_bits", "read_grey", "read_header",
]  # fmt: skip

Grey = NDArray[np.uint8 | np.uint16]

Region = tuple[tuple[int, int], tuple[int, int]]
"""First row and the one behind the last, first column and the one behind the last."""

REDUCTIONS = (1, 2, 4, 8)

_DAMAGED = (OSError, ValueError, SyntaxError, LookupError, TypeError, struct.error, OverflowError, RuntimeError)
"""What Pillow and OpenCV raise for damaged files."""

_NO_PILLOW, _NO_OPENCV = (
    f"images are read with {library}, which is not installed; pip install 'orip[images]'"
    for library in ("Pillow", "OpenCV")
)

_LUMA = np.array([0.299, 0.587, 0.114])
"""Of red, green and blue in grey, as in JPEG (ITU-R BT.601)."""

_WHITE_IS_ZERO, _OLD_JPEG = 0, 6

_ROWS_AT_ONCE = 256


def read_grey(path: Path, region: Region | None = None, reduction: int = 1, shown: str = "") -> Grey:
    """Read the grey values of an image file.

    Memory is that of the image for JPEG and PNG, whose rows depend on those before, and for TIFF that of the region
    and a strip or a row of tiles. A reduced JPEG is decoded smaller (its first coefficients).

    Parameters
    ----------
    region : pair of pairs of int, optional
        Rows and columns of the stored image, each from the first to the one behind the last; what is beyond the image
        is left out. The first ones are multiples of `reduction`.
    reduction : {1, 2, 4, 8}, optional
        So many rows and columns become one, by their mean.
    shown : str, optional
        The file as the user would name it, for messages; else the path.

    Returns
    -------
    array of uint8 or uint16, (rows, columns)
        Rows and columns of the region divided by `reduction`, rounded up.

    Raises
    ------
    InputError
        If the file cannot be used (`read_header`), its pixels are damaged, or Pillow is not installed; of colour with
        16 bits, if OpenCV is not installed.
    ValueError
        If the reduction is another one, or the region does not begin at a multiple of it, or is empty.
    """
    header = read_header(path, shown)
    rows, columns = _clipped(region, header, reduction)
    with _reading(path, shown or str(path)) as file:
        if header.format == "TIFF":
            grey: Grey = _reduced(_tiff_region(file, rows, columns), reduction)
        elif header.bits == 16:
            grey = _reduced(_sixteen_bits(file, header)[rows, columns], reduction)
        else:
            grey = _eight_bits(file, header, rows, columns, reduction)
    return np.ascontiguousarray(grey)


def read_eight_bits(path: Path, shown: str = "") -> NDArray[np.uint8]:
    """Return the grey values of an image as stored, (rows, columns), of 8 bits.

    Of 16 bits the range between the darkest and the brightest one in a thousand becomes 8.

    Raises
    ------
    InputError
        If it is damaged.
    """
    return in_eight_bits(read_grey(path, shown=shown))


def in_eight_bits(grey: Grey) -> NDArray[np.uint8]:
    """Return grey values (rows, columns) in 8 bits; see `read_eight_bits`."""
    if grey.dtype == np.uint8:
        return grey.astype(np.uint8, copy=False)
    low, high = np.percentile(grey[::4, ::4], [0.1, 99.9])
    scaled = (grey.astype(np.float32) - low) * (255.0 / max(float(high - low), 1.0))
    found: NDArray[np.uint8] = np.clip(np.rint(scaled), 0, 255).astype(np.uint8)
    return found


def read_colours(path: Path, reduction: int = 1, shown: str = "") -> NDArray[np.uint8]:
    """Read an image with its colours, 8 bits each, to be looked at.

    Returns
    -------
    array of uint8, (rows, columns, 3)
        Red, green, blue; not turned.

    Raises
    ------
    InputError, ValueError
        As `read_grey`.
    """
    header = read_header(path, shown)
    if header.format == "TIFF" or header.bits == 16 or header.channels == 1:
        grey = read_grey(path, None, reduction, shown)
        eight = (grey >> 8 if grey.dtype == np.uint16 else grey).astype(np.uint8)
        return np.repeat(eight[:, :, None], 3, axis=2)
    _clipped(None, header, reduction)
    with _reading(path, shown or str(path)) as file, _pillow(file, header) as image:
        image.draft("RGB", (header.columns // reduction, header.rows // reduction))
        left = reduction // -(-header.columns // image.size[0])
        # of what is in these colours already it would be a copy
        colours = image if image.mode == "RGB" else image.convert("RGB")
        return _array_of(colours if left == 1 else colours.reduce(left))


def _array_of(picture: Any) -> NDArray[np.uint8]:
    """Return the colours of a picture of Pillow, some rows at a time: all at once would be in memory twice more."""
    columns, rows = picture.size
    found = np.empty((rows, columns, 3), dtype=np.uint8)
    for top in range(0, rows, _ROWS_AT_ONCE):
        last = min(top + _ROWS_AT_ONCE, rows)
        found[top:last] = np.asarray(picture.crop((0, top, columns, last)))
    return found


@contextmanager
def _reading(path: Path, shown: str) -> Iterator[BufferedReader]:
    """Open an image; what its decoder raises becomes a sentence, and what it warns of is not printed."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            with open_regular(path, LARGEST_IMAGE_FILE) as file:
                yield file
    except Unreadable as fault:
        raise InputError.single(str(fault), shown) from None
    except _DAMAGED as fault:
        message = f"its pixels cannot be decoded ({fault}); copy it again, or export it as JPEG, PNG or TIFF"
        raise InputError.single(message, shown) from None


def _clipped(region: Region | None, header: ImageHeader, reduction: int) -> tuple[slice, slice]:
    if reduction not in REDUCTIONS:
        message = f"an image is made smaller {', '.join(map(str, REDUCTIONS))} times, not {reduction}"
        raise ValueError(message)
    (top, bottom), (left, right) = region or ((0, header.rows), (0, header.columns))
    if top % reduction or left % reduction:
        message = f"row {top} and column {left} are no multiples of the reduction, {reduction}"
        raise ValueError(message)
    rows = slice(max(top, 0), min(bottom, header.rows))
    columns = slice(max(left, 0), min(right, header.columns))
    if rows.stop <= rows.start or columns.stop <= columns.start:
        message = f"the region {region} has no pixel of an image of {header.columns} x {header.rows}"
        raise ValueError(message)
    return rows, columns


def _reduced(grey: Grey, reduction: int) -> Grey:
    """Return means of squares of pixels; those at the right and lower edge are of what there is."""
    if reduction == 1:
        return grey
    rows, columns = grey.shape
    padded = np.pad(grey, ((0, -rows % reduction), (0, -columns % reduction)), mode="edge")
    squares = padded.reshape(padded.shape[0] // reduction, reduction, -1, reduction)
    means = squares.sum(axis=(1, 3), dtype=np.uint32)
    smaller: Grey = ((means + reduction**2 // 2) // reduction**2).astype(grey.dtype)
    return smaller


def _eight_bits(file: BufferedReader, header: ImageHeader, rows: slice, columns: slice, reduction: int) -> Grey:
    with _pillow(file, header) as image:
        image.draft("L", (header.columns // reduction, header.rows // reduction))
        decoded = -(-header.columns // image.size[0])
        grey: Grey = np.asarray(image.convert("L"), dtype=np.uint8)
    return _reduced(grey[_divided(rows, decoded), _divided(columns, decoded)], reduction // decoded)


def _divided(part: slice, divisor: int) -> slice:
    return slice(part.start // divisor, -(-part.stop // divisor))


def _pillow(file: BufferedReader | BytesIO, header: ImageHeader) -> Any:
    """Open an image by the class of its format: `Image.open` counts pixels against a limit for the whole process."""
    try:
        from PIL import JpegImagePlugin, PngImagePlugin
    except ImportError:
        raise InputError.single(_NO_PILLOW) from None
    return PngImagePlugin.PngImageFile(file) if header.format == "PNG" else JpegImagePlugin.JpegImageFile(file)


def _sixteen_bits(file: BufferedReader, header: ImageHeader) -> NDArray[np.uint16]:
    """Return the grey values of a PNG of 16 bits; of colours Pillow would keep 8 bits."""
    if header.channels == 1:
        with _pillow(file, header) as image:
            return np.asarray(image).astype(np.uint16)
    return _decoded_by_opencv(file.read())


def _decoded_by_opencv(data: bytes) -> NDArray[np.uint16]:
    try:
        import cv2
    except ImportError:
        raise InputError.single(_NO_OPENCV) from None
    flags = cv2.IMREAD_UNCHANGED | cv2.IMREAD_IGNORE_ORIENTATION
    colours = cv2.imdecode(np.frombuffer(data, dtype=np.uint8), flags)
    if colours is None:
        message = "the image is damaged"
        raise ValueError(message)
    grey = np.empty(colours.shape[:2], dtype=np.uint16)
    if colours.ndim == 2:
        grey[:] = colours
        return grey
    for row, line in enumerate(colours):  # a row at a time: floats of the whole image would be four times its size
        grey[row] = np.rint(line[:, 2::-1] @ _LUMA)
    return grey


def _tiff_region(file: BufferedReader, rows: slice, columns: slice) -> Grey:
    """Decode those strips or tiles of a TIFF that have pixels of a region."""
    page = tiff_directory(file)
    if page.first(259, 1) == _OLD_JPEG or (page.first(284, 1) == 2 and page.first(277, 1) > 1):
        message = "its pixels are compressed or ordered in a way that orip does not read; export it as PNG or TIFF"
        raise Unreadable(message)
    kind = np.uint16 if page.first(258, 1) == 16 else np.uint8
    grey = np.empty((rows.stop - rows.start, columns.stop - columns.start), dtype=kind)
    for index, top, left, height, width in _chunks_in(page, rows, columns):
        chunk = _chunk(file, page, index, height, width)
        first, last = max(top, rows.start), min(top + height, rows.stop)
        start, stop = max(left, columns.start), min(left + width, columns.stop)
        part = chunk[first - top : last - top, start - left : stop - left]
        grey[first - rows.start : last - rows.start, start - columns.start : stop - columns.start] = part
    return grey


def _chunks_in(page: TiffDirectory, rows: slice, columns: slice) -> Iterator[tuple[int, int, int, int, int]]:
    """Yield index, first row, first column, height and width of the strips or tiles that have pixels of a region."""
    all_columns, all_rows = page.first(256), page.first(257)
    width, height = page.first(322), page.first(323)
    is_tiled = bool(width and height)
    if not is_tiled:
        width, height = all_columns, min(page.first(278) or all_rows, all_rows)
    across = -(-all_columns // width)
    for down in range(rows.start // height, -(-rows.stop // height)):
        tall = height if is_tiled else min(height, all_rows - down * height)
        for along in range(columns.start // width, -(-columns.stop // width)):
            yield down * across + along, down * height, along * width, tall, width


def _chunk(file: BufferedReader, page: TiffDirectory, index: int, height: int, width: int) -> Grey:
    """Return the grey values of a strip or tile, decoded as a TIFF of its own, which has it as its only strip."""
    offsets, lengths = (page.numbers.get(tag, ()) for tag in ((324, 325) if page.first(322) else (273, 279)))
    file.seek(offsets[index])
    data = file.read(lengths[index] if lengths else height * width * page.first(277, 1) * 2)
    small = _one_strip(page, height, width, data)
    is_grey = page.first(262, 1) in {0, 1} and page.first(277, 1) == 1
    if page.first(258, 1) == 16 and not is_grey:
        return _decoded_by_opencv(small)
    try:
        from PIL import TiffImagePlugin
    except ImportError:
        raise InputError.single(_NO_PILLOW) from None
    with TiffImagePlugin.TiffImageFile(BytesIO(small)) as image:
        if page.first(258, 1) < 16:
            return np.asarray(image.convert("L"), dtype=np.uint8)
        grey = np.asarray(image).astype(np.uint16)
    # Pillow inverts what has white as zero for 8 bits alone
    return np.uint16(65535) - grey if page.first(262, 1) == _WHITE_IS_ZERO else grey


_OF_A_STRIP = (258, 259, 262, 266, 277, 284, 317, 338, 339, 530, 532)
"""Tags that a strip or tile has from its page: numbers of 16 bits that say how its pixels are written."""


def _one_strip(page: TiffDirectory, height: int, width: int, data: bytes) -> bytes:
    """Return a TIFF of one strip."""
    entries: dict[int, tuple[str, tuple[int, ...] | bytes]] = {
        256: ("I", (width,)), 257: ("I", (height,)), 278: ("I", (height,)), 279: ("I", (len(data),)),
    }  # fmt: skip
    entries |= {tag: ("H", page.numbers[tag]) for tag in _OF_A_STRIP if tag in page.numbers}
    if 320 in page.numbers:
        entries[320] = ("H", page.numbers[320])
    if 347 in page.bytes_of:
        entries[347] = ("7", page.bytes_of[347])
    return _written(page.order, entries, data)


def _written(order: str, entries: dict[int, tuple[str, tuple[int, ...] | bytes]], data: bytes) -> bytes:
    """Write a directory, what does not fit in it, and the strip behind (tag 273)."""
    count = len(entries) + 1
    behind, rows_of_directory = b"", b""
    place = 8 + 2 + 12 * count + 4
    packed = {
        tag: values if isinstance(values, bytes) else struct.pack(f"{order}{len(values)}{kind}", *values)
        for tag, (kind, values) in entries.items()
    }
    long_ones = sum(len(value) + len(value) % 2 for value in packed.values() if len(value) > 4)
    packed[273] = struct.pack(f"{order}I", place + long_ones)
    kinds = {"H": 3, "I": 4, "7": 7}
    for tag in sorted(packed):
        value = packed[tag]
        kind = kinds[entries[tag][0]] if tag in entries else 4
        number = len(value) // {3: 2, 4: 4, 7: 1}[kind]
        if len(value) > 4:
            rows_of_directory += struct.pack(f"{order}HHII", tag, kind, number, place + len(behind))
            behind += value + b"\0" * (len(value) % 2)
        else:
            rows_of_directory += struct.pack(f"{order}HHI", tag, kind, number) + value.ljust(4, b"\0")
    head = (b"II*\0" if order == "<" else b"MM\0*") + struct.pack(f"{order}IH", 8, count)
    return head + rows_of_directory + b"\0" * 4 + behind + data


def jpeg_of(pixels: NDArray[np.uint8] | Any, **settings: Any) -> bytes:
    """Return grey values (rows, columns), colours (rows, columns, 3), or a picture of Pillow as JPEG.

    Settings are those of Pillow, such as ``quality``.
    """
    from PIL import Image

    written = BytesIO()
    picture: Any = Image.fromarray(np.ascontiguousarray(pixels)) if isinstance(pixels, np.ndarray) else pixels
    picture.save(written, "JPEG", **settings)
    return written.getvalue()
