"""Pictures for measuring: one band, as it is stored, within bounded memory."""

from __future__ import annotations

import warnings
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from msgspec import Struct

from orip.files.text.regular_file import regular_bytes
from orip.pictures.targets.packages import opencv, pillow

LARGEST = 200_000_000
"""Pixels."""

ENDINGS = (".jpg", ".jpeg", ".png", ".tif", ".tiff")


class Band(Struct, frozen=True):
    """A band of a picture, or why there is none.

    Parameters
    ----------
    grey : array (rows, columns) or None
        uint8 or uint16; rows and columns as stored, not turned by EXIF orientation.
    fault : str
    """

    grey: Any
    fault: str = ""


def read_green(path: Path) -> Band:
    """Read the green band of a picture, or the only one.

    A lens images each colour at another scale. Grey values that mix the bands have edges of three widths; green alone
    is the sharpest band of nearly all sensors, with twice as many pixels as the others.
    """
    try:
        data = regular_bytes(path)
    except OSError as error:
        return Band(None, f"cannot be read ({error.strerror or error})")
    fault = _fault_of_header(data)
    if fault:
        return Band(None, fault)
    cv2 = opencv()
    flags = cv2.IMREAD_ANYCOLOR | cv2.IMREAD_ANYDEPTH | cv2.IMREAD_IGNORE_ORIENTATION
    try:
        picture = cv2.imdecode(np.frombuffer(data, dtype=np.uint8), flags)
    except cv2.error:
        picture = None
    if picture is None or picture.dtype not in {np.dtype(np.uint8), np.dtype(np.uint16)}:
        return Band(None, "cannot be decoded: it is damaged, or not of 8 or 16 bits a band")
    return Band(np.ascontiguousarray(picture if picture.ndim == 2 else picture[..., 1]))


def _fault_of_header(data: bytes) -> str:
    image = pillow()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of sizes; they are judged here
            with image.open(BytesIO(data)) as opened:
                columns, rows = opened.size
                frames = getattr(opened, "n_frames", 1)
                if opened.format not in {"JPEG", "MPO", "PNG", "TIFF"}:
                    return f"is {opened.format}; JPEG, PNG and TIFF are read"
                if frames > 1 and opened.format == "PNG":
                    return "is animated"
    except (OSError, ValueError, SyntaxError, image.DecompressionBombError):
        return "is no picture" if data else "is empty"
    if columns * rows > LARGEST:
        return f"has {columns} x {rows} pixels; {LARGEST // 1_000_000} million are allowed"
    return ""
