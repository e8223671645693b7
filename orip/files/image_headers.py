"""What the head of an image file says, without a library: size, depth, colours, and whether the file is whole.

JPEG (ITU T.81, CIPA DC-008 for EXIF), PNG (ISO 15948) and TIFF 6.0 with BigTIFF. No pixel is decoded, so that a file
of any size costs some kilobytes and a thousand files some seconds.
"""

from __future__ import annotations

import os
import struct
from collections.abc import Callable, Iterator, Mapping
from io import BytesIO
from pathlib import Path
from typing import BinaryIO, Literal

from msgspec import Struct

from orip.errors import InputError
from orip.files.text.regular_file import open_regular

LARGEST_IMAGE_FILE = 3 << 30
"""Bytes: 200 megapixels of 16-bit colour have 1.2 GB."""

MOST_PIXELS, FEWEST_ON_A_SIDE = 200_000_000, 16

ImageFormat = Literal["JPEG", "PNG", "TIFF"]

IMAGE_ENDINGS = (".jpg", ".jpeg", ".png", ".tif", ".tiff")
"""Of the files whose pixels orip reads."""

_END_OF_IMAGE = b"\xff\xd9"
_SEARCHED_AT_ONCE = 1 << 16
_MOST_SEGMENTS, _MOST_PAGES = 100_000, 64
_FRAMES = (*range(0xC0, 0xC4), *range(0xC5, 0xC8), *range(0xC9, 0xCC), *range(0xCD, 0xD0))
"""Markers of JPEG that have the size of the image."""
_START_OF_SCAN, _APP1 = 0xDA, 0xE1
_STAND_ALONE = (0x01, *range(0xD0, 0xD8))
"""Markers of JPEG without a length."""

_VALUES = {1: "B", 3: "H", 4: "I", 13: "I", 16: "Q", 18: "Q"}
_SIZES = {1: 1, 3: 2, 4: 4, 7: 1, 13: 4, 16: 8, 18: 8}
"""Of the types of TIFF that are read, in bytes: whole numbers, and bytes without meaning."""
_READ = frozenset({
    254, 256, 257, 258, 259, 262, 266, 273, 274, 277, 278, 279, 284, 317, 320, 322, 323, 324, 325, 338, 339, 347, 530,
    532,
})  # fmt: skip
"""Tags: what is needed for the pixels, and the orientation."""
_LONGEST_TAG = 1 << 24


class ImageHeader(Struct, frozen=True):
    """What an image file says of its pixels, as they are stored.

    Parameters
    ----------
    columns, rows : int
        Of the stored pixels, whatever `orientation` says of how they are to be shown.
    bits : int
        8 or 16 for each channel.
    channels : int
        1 grey, 3 colour; transparency is not counted.
    orientation : int
        1 to 8, as EXIF has it: 1 shown as stored, 6 turned by 90 degrees clockwise, 8 counter-clockwise, 3 by 180.
    format : {"JPEG", "PNG", "TIFF"}
    """

    path: Path
    columns: int
    rows: int
    bits: int
    channels: int
    orientation: int
    format: ImageFormat


class TiffDirectory(Struct, frozen=True):
    """A page of a TIFF: its tags by number, those of whole numbers and those of bytes, and where the next page is."""

    order: Literal["<", ">"]
    numbers: Mapping[int, tuple[int, ...]]
    bytes_of: Mapping[int, bytes]
    following: int

    def first(self, tag: int, default: int = 0) -> int:
        """Return the first number of a tag."""
        values = self.numbers.get(tag)
        return values[0] if values else default


class Unreadable(Exception):  # noqa: N818  # a sentence about the file, which becomes an InputError with its name
    """Why an image file cannot be used; the text goes on after the name of the file."""


def read_header(path: Path, shown: str = "") -> ImageHeader:
    """Read what an image file says of itself, without decoding pixels.

    Parameters
    ----------
    shown : str, optional
        The file as the user would name it, for messages; else the path.

    Raises
    ------
    InputError
        With one sentence: it is no file, empty, cut off, no JPEG, PNG or TIFF, animated or of several pages, has the
        colours of a printer (CMYK), pixels that are not whole numbers, more than `MOST_PIXELS` of them, or fewer than
        `FEWEST_ON_A_SIDE` on a side.
    """
    name = shown or str(path)
    try:
        with open_regular(path, LARGEST_IMAGE_FILE) as file:
            header = _header(file, path)
    except Unreadable as fault:
        raise InputError.single(str(fault), name) from None
    except (struct.error, OverflowError, LookupError):
        message = "it is damaged; export it again as JPEG, PNG or TIFF"
        raise InputError.single(message, name) from None
    except (OSError, ValueError) as fault:
        message = f"it cannot be read: {getattr(fault, 'strerror', None) or fault}"
        raise InputError.single(message, name) from None
    if size_fault := _size_fault(header.columns, header.rows):
        raise InputError.single(size_fault, name)
    return header


def _header(file: BinaryIO, path: Path) -> ImageHeader:
    head = file.read(16)
    if not head:
        message = "it is empty (0 bytes); copy it again"
        raise Unreadable(message)
    readers: tuple[tuple[tuple[bytes, ...], Callable[[BinaryIO, Path], ImageHeader]], ...] = (
        ((b"\xff\xd8\xff",), _jpeg),
        ((b"\x89PNG\r\n\x1a\n",), _png),
        ((b"II*\0", b"MM\0*", b"II+\0", b"MM\0+"), _tiff),
    )
    for beginnings, read in readers:
        if head.startswith(beginnings):
            return read(file, path)
    message = "it is no JPEG, PNG or TIFF, which are the images that orip reads; export it as one of them"
    raise Unreadable(message)


def _size_fault(columns: int, rows: int) -> str | None:
    size = f"it has {columns} x {rows} pixels"
    if columns * rows > MOST_PIXELS:
        return f"{size}; orip reads up to {MOST_PIXELS // 1_000_000} megapixels: divide it, or make it smaller"
    if min(columns, rows) < FEWEST_ON_A_SIDE:
        return f"{size}; a photo has {FEWEST_ON_A_SIDE} and more on each side"
    return None


def _cut_off() -> Unreadable:
    return Unreadable("it is cut off: the end of the image is missing; copy it again")


def _colours_of_a_printer() -> Unreadable:
    return Unreadable("it has the colours of a printer (CMYK); export it as RGB or grey")


def _jpeg(file: BinaryIO, path: Path) -> ImageHeader:
    orientation, frame = 1, (0, 0, 0, 0)
    for marker, length in _segments(file):
        if marker in _FRAMES:
            frame = struct.unpack(">BHHB", file.read(6))
        elif marker == _APP1 and orientation == 1:
            orientation = exif_orientation(file.read(length))
    bits, rows, columns, channels = frame
    if bits == 0 or not _has_end(file, file.tell()):
        raise _cut_off()
    if channels == 4:
        raise _colours_of_a_printer()
    if bits != 8:
        message = f"it is a JPEG with {bits} bits for each channel, not 8; export it as PNG or TIFF of 16 bits"
        raise Unreadable(message)
    return ImageHeader(path, columns, rows, 8, 1 if channels == 1 else 3, orientation, "JPEG")


def _segments(file: BinaryIO) -> Iterator[tuple[int, int]]:
    """Yield marker and length of the content of each segment of a JPEG up to the first scan.

    The file stands at the content.
    """
    place = 2
    for _ in range(_MOST_SEGMENTS):
        file.seek(place)
        head = file.read(4)
        if len(head) < 4:
            raise _cut_off()
        if head[0] != 0xFF:
            message = "it is damaged: a segment of the JPEG does not begin where the one before ends; copy it again"
            raise Unreadable(message)
        marker, length = head[1], int.from_bytes(head[2:], "big")
        if marker == 0xFF or marker in _STAND_ALONE:
            place += 1 if marker == 0xFF else 2
            continue
        yield marker, max(length - 2, 0)
        if marker == _START_OF_SCAN:
            return
        place += 2 + length


def _has_end(file: BinaryIO, after: int) -> bool:
    """Tell whether the mark of the end stands behind the pixels; compressed pixels never look like it."""
    end = _size_of(file)
    while end > after:
        start = max(end - _SEARCHED_AT_ONCE, after)
        file.seek(start)
        if _END_OF_IMAGE in file.read(end - start):
            return True
        end = start + 1 if start > after else after
    return False


def exif_orientation(data: bytes) -> int:
    """Return the orientation (1 to 8) that a block of EXIF has; 1 if it has none or is damaged."""
    data = data.removeprefix(b"Exif\0\0")
    if not data.startswith((b"II*\0", b"MM\0*")):
        return 1
    try:
        orientation = tiff_directory(BytesIO(data)).first(274, 1)
    except (Unreadable, struct.error, ValueError):
        return 1
    return orientation if 1 <= orientation <= 8 else 1


def _png(file: BinaryIO, path: Path) -> ImageHeader:
    size, place, orientation, head = _size_of(file), 8, 1, b""
    while True:
        file.seek(place)
        start = file.read(8)
        if len(start) < 8:
            raise _cut_off()
        length, kind = int.from_bytes(start[:4], "big"), start[4:]
        place += 12 + length
        if place > size:
            raise _cut_off()
        if kind == b"IHDR":
            head = file.read(13)
        elif kind == b"acTL":
            message = "it is animated (APNG); export the picture that is meant by itself"
            raise Unreadable(message)
        elif kind == b"eXIf":
            orientation = exif_orientation(file.read(length))
        elif kind == b"IEND":
            break
    columns, rows, bits, colours = struct.unpack(">IIBB", head[:10])
    channels = 1 if colours in (0, 4) else 3
    return ImageHeader(path, columns, rows, 16 if bits == 16 else 8, channels, orientation, "PNG")


def _tiff(file: BinaryIO, path: Path) -> ImageHeader:
    page = tiff_directory(file)
    _require_one_page(file, page)
    columns, rows, bits = page.first(256), page.first(257), page.first(258, 1)
    if page.first(262) == 5:
        raise _colours_of_a_printer()
    if page.first(262, 1) not in {0, 1, 2, 3, 6} or page.first(254) & 1:
        message = (
            "it has the pixels of a sensor as they are (raw), or a preview of them; export it as JPEG, PNG or TIFF"
        )
        raise Unreadable(message)
    if page.first(339, 1) not in {1, 4} or bits not in {1, 2, 4, 8, 16}:
        message = f"it has pixels of {bits} bits that are not whole numbers of 8 or 16 bits; export it with those"
        raise Unreadable(message)
    # before the lengths of strips, which a size without limit would have millions of
    if _size_fault(columns, rows) is None:
        _require_strips(file, page)
    channels = 3 if page.first(262, 1) in {2, 3, 6} else 1
    orientation = page.first(274, 1)
    return ImageHeader(
        path, columns, rows, 16 if bits == 16 else 8, channels, orientation if 1 <= orientation <= 8 else 1, "TIFF"
    )


def _require_one_page(file: BinaryIO, page: TiffDirectory) -> None:
    """Refuse several pages of one size; smaller copies of the first page, previews and masks are passed over."""
    following, size = page.following, (page.first(256), page.first(257))
    for _ in range(_MOST_PAGES):
        if not following:
            return
        other = tiff_directory(file, following)
        if not other.first(254) & 5 and (other.first(256), other.first(257)) == size:
            message = "it has several pages; export the one that is meant by itself"
            raise Unreadable(message)
        following = other.following


def _require_strips(file: BinaryIO, page: TiffDirectory) -> None:
    tags = (324, 325) if page.first(322) else (273, 279)
    offsets, lengths = (page.numbers.get(tag, ()) for tag in tags)
    size = _size_of(file)
    if not offsets or any(offset + length > size for offset, length in zip(offsets, lengths, strict=False)):
        raise _cut_off()


def tiff_directory(file: BinaryIO, place: int | None = None) -> TiffDirectory:
    """Read a page of a TIFF: the first one, or that at a place of the file.

    Raises
    ------
    Unreadable, struct.error
        If the file is cut off.
    """
    file.seek(0)
    head = file.read(16)
    order: Literal["<", ">"] = "<" if head.startswith(b"II") else ">"
    is_big = head[2:4] in {b"+\0", b"\0+"}
    if place is None:
        (place,) = struct.unpack(f"{order}Q", head[8:16]) if is_big else struct.unpack(f"{order}I", head[4:8])
    size = _size_of(file)
    counting, entry, long = ("Q", "HHQ8s", "Q") if is_big else ("H", "HHI4s", "I")
    count_size, entry_size = struct.calcsize(f"{order}{counting}"), struct.calcsize(f"{order}{entry}")
    file.seek(min(place, size))
    (count,) = struct.unpack(f"{order}{counting}", file.read(count_size))
    if count * entry_size > size:
        raise _cut_off()
    entries = file.read(count * entry_size)
    behind = file.read(struct.calcsize(long))
    numbers: dict[int, tuple[int, ...]] = {}
    bytes_of: dict[int, bytes] = {}
    for tag, kind, length, value in struct.iter_unpack(f"{order}{entry}", entries):
        if tag not in _READ or kind not in _SIZES:
            continue
        data = _data(file, size, length * _SIZES[kind], value, f"{order}{long}")
        if kind in _VALUES:
            numbers[tag] = struct.unpack(f"{order}{length}{_VALUES[kind]}", data)
        else:
            bytes_of[tag] = data
    following = struct.unpack(f"{order}{long}", behind)[0] if len(behind) == struct.calcsize(long) else 0
    return TiffDirectory(order, numbers, bytes_of, following)


def _data(file: BinaryIO, size: int, wanted: int, value: bytes, long: str) -> bytes:
    """Return the bytes of a tag: in the entry itself where they fit, else elsewhere in the file."""
    if wanted <= len(value):
        return value[:wanted]
    (place,) = struct.unpack(long, value)
    if place + wanted > size or wanted > _LONGEST_TAG:
        raise _cut_off()
    file.seek(place)
    return file.read(wanted)


def _size_of(file: BinaryIO) -> int:
    if isinstance(file, BytesIO):
        return file.getbuffer().nbytes
    return os.fstat(file.fileno()).st_size
