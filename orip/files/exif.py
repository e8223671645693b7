"""Positions, gimbal angles and times in the image files themselves (EXIF, and XMP of DJI)."""

from __future__ import annotations

import logging
import math
import os
import re
import struct
from collections.abc import Mapping
from io import BufferedReader
from pathlib import Path
from typing import Any, BinaryIO, cast

import numpy as np
from msgspec import Struct

from orip.errors import Complaint, InputError
from orip.files.text.regular_file import natural_key, open_regular
from orip.files.text.shown import Parsed
from orip.records.epochs import Epochs, Quality, epochs, seconds_of_date
from orip.records.names import name_fault
from orip.units import RADIANS_PER_DEGREE

ENDINGS = (".jpg", ".jpeg", ".tif", ".tiff", ".dng", ".heic", ".png")

_SEARCHED = 1 << 20
"""Bytes of a file in which XMP is looked for."""

MOST_IMAGES = 100_000

DAMAGED = (
    ValueError, LookupError, TypeError, AttributeError, ArithmeticError, AssertionError, struct.error, OSError,
    RecursionError, MemoryError, RuntimeError, EOFError,
)  # fmt: skip
"""What the reader of EXIF raises for damaged files."""


class Exposure(Struct, frozen=True):
    """When and where an image was taken; NaN where that is not known.

    Parameters
    ----------
    place : tuple of 3 float
        Longitude, latitude (radians) and height (m).
    errors : tuple of 3 float
        Standard deviations east, north, up, m.
    angles : tuple of 3 float
        Roll, pitch and yaw of the gimbal, radians.
    time : float
        Seconds.
    """

    place: tuple[float, float, float]
    errors: tuple[float, float, float]
    angles: tuple[float, float, float]
    time: float
    quality: Quality


def image_files(folder: Path) -> list[Path]:
    """Return the image files of a folder in natural order."""
    found = [path for path in folder.iterdir() if path.suffix.lower() in ENDINGS]
    return sorted(found, key=lambda path: natural_key(path.name))[:MOST_IMAGES]


def read_images(paths: list[Path], shown: str) -> Parsed[Epochs]:
    """Read where and when image files say that they were taken; names are those of the files without ending.

    The time is that of the camera's clock: only its differences count.

    Raises
    ------
    InputError
        If the library that reads EXIF is not installed.
    """
    images, complaints = [], []
    for path in paths:
        try:
            images.append(exposure_of(image_tags(path)))
        except DAMAGED as fault:
            reason = type(fault).__name__
            complaints.append(Complaint(f"its EXIF data cannot be read ({reason}); take the file out", path.name))
        if fault_of_name := name_fault(path.stem):
            complaints.append(Complaint(fault_of_name, path.name))
    if complaints:
        return Parsed(epochs(shown, np.zeros(0, dtype=np.int64)), tuple(complaints))
    count = len(images)
    errors = np.array([image.errors for image in images], dtype=np.float64).reshape(count, 3)
    return Parsed(
        epochs(
            shown,
            np.arange(1, count + 1),
            photo=tuple(path.stem for path in paths),
            time=np.array([image.time for image in images], dtype=np.float64),
            place=np.array([image.place for image in images], dtype=np.float64).reshape(count, 3),
            covariance=errors[:, :, None] * np.eye(3) * errors[:, None, :],
            quality=tuple(image.quality for image in images),
            angles=np.array([image.angles for image in images], dtype=np.float64).reshape(count, 3),
            mount="gimbal",
        )
    )


class ImageTags(Struct, frozen=True):
    """What an image file says of itself: tags of EXIF by name, and numbers of DJI's XMP."""

    exif: Mapping[str, Any]
    xmp: Mapping[str, float]


def image_tags(path: Path) -> ImageTags:
    """Read the tags of an image file.

    Raises
    ------
    InputError
        If the library that reads EXIF is not installed.
    """
    try:
        import exifread
    except ImportError:
        message = "image files are read with exifread, which is not installed; pip install 'orip[exif]'"
        raise InputError.single(message) from None
    # what it logs of damaged files is said in a complaint
    logging.getLogger("exifread").setLevel(logging.CRITICAL)
    with open_regular(path) as file:
        tags: Mapping[str, Any] = exifread.process_file(cast(BinaryIO, _UpToTheEnd(file)), details=False)
        file.seek(0)
        return ImageTags(tags, _xmp(file.read(_SEARCHED)))


class _UpToTheEnd:
    """A file of which no more is asked than it has: Python takes the memory for all that is asked before it reads."""

    def __init__(self, file: BufferedReader) -> None:
        self._file, self._size = file, os.fstat(file.fileno()).st_size
        self.seek, self.tell = file.seek, file.tell

    def read(self, size: int = -1) -> bytes:
        left = max(self._size - self._file.tell(), 0)
        return self._file.read(left if size < 0 else min(size, left))


def exposure_of(found: ImageTags) -> Exposure:
    """Return when and where an image was taken."""
    tags, xmp = found.exif, found.xmp
    height = _first(xmp, tags, ("AbsoluteAltitude",), "GPS GPSAltitude", "GPS GPSAltitudeRef")
    longitude = _first(xmp, tags, ("GpsLongitude", "GpsLongtitude"), "GPS GPSLongitude", "GPS GPSLongitudeRef")
    latitude = _first(xmp, tags, ("GpsLatitude",), "GPS GPSLatitude", "GPS GPSLatitudeRef")
    if not (abs(latitude) <= 90.0 and abs(longitude) <= 360.0 and abs(height) <= 1e6):
        longitude = latitude = height = math.nan
    flag = xmp.get("RtkFlag", math.nan)
    quality: Quality = "fixed" if flag == 50 else "float" if 32 <= flag < 50 else "code"
    return Exposure(
        place=(longitude * RADIANS_PER_DEGREE, latitude * RADIANS_PER_DEGREE, height),
        errors=_triple(xmp, "RtkStdLon", "RtkStdLat", "RtkStdHgt"),
        angles=_triple(xmp, "GimbalRollDegree", "GimbalPitchDegree", "GimbalYawDegree", RADIANS_PER_DEGREE),
        time=_time(tags),
        quality=quality,
    )


def _triple(xmp: Mapping[str, float], one: str, two: str, three: str, unit: float = 1.0) -> tuple[float, float, float]:
    values = [xmp.get(key, math.nan) * unit for key in (one, two, three)]
    return values[0], values[1], values[2]


def _xmp(data: bytes) -> dict[str, float]:
    """Return the numbers that DJI writes into XMP, as attributes or elements."""
    start = data.find(b"<x:xmpmeta")
    end = data.find(b"</x:xmpmeta>", start)
    if start < 0 or end < 0:
        return {}
    text = data[start:end].decode("utf-8", errors="replace")
    pattern = r"drone-dji:(\w{1,40})\s*(?:=\s*\"|>)\s*([+-]?\d{1,9}(?:\.\d{1,15})?)\s*(?:\"|<)"
    return {match[1]: float(match[2]) for match in re.finditer(pattern, text)}


def _first(xmp: Mapping[str, float], tags: Mapping[str, Any], keys: tuple[str, ...], tag: str, reference: str) -> float:
    """Return a coordinate of XMP, which has more digits, else of EXIF; NaN if there is none."""
    for key in keys:
        if key in xmp:
            return xmp[key]
    if tag not in tags:
        return math.nan
    parts = [float(part) for part in tags[tag].values]
    sign = -1.0 if str(tags.get(reference, "")).strip() in {"S", "W", "1"} else 1.0
    return sign * sum(part / 60.0**power for power, part in enumerate(parts[:3]))


def _time(tags: Mapping[str, Any]) -> float:
    written = str(tags.get("EXIF DateTimeOriginal", "")).strip()
    match = re.fullmatch(r"(\d{4}:\d{2}:\d{2})[ T](\d{2}:\d{2}:\d{2})", written)
    if match is None:
        return math.nan
    parts = re.sub(r"\D", "", str(tags.get("EXIF SubSecTimeOriginal", "")))[:9]
    return seconds_of_date(match[1], f"{match[2]}.{parts or '0'}")
