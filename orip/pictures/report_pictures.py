"""Pictures for reports: thumbnails of photos and chips of measured places, as small JPEG data addresses."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from orip.arrays import IntArray
from orip.errors import InputError
from orip.images.image_files import REDUCTIONS, Grey, jpeg_of, read_colours, read_grey, read_header
from orip.progress import stage
from orip.records.names import record_key
from orip.report.report_input import CHIP_PIXELS, AskedImage, GivenImage, PictureSource
from orip.threads import available_threads, by_threads

THUMBNAIL_BYTES = 11_000
"""Largest JPEG of a thumbnail: 15 kB as text in the page."""
CHIP_BYTES = 2_200
"""Largest JPEG of a chip: 3 kB as text."""
_LONGER_SIDE = 360
_QUALITIES = (80, 70, 60, 50, 40, 30, 20)
_DARKEST, _BRIGHTEST = 1.0, 99.0
"""Percent of the grey values that a chip shows as black and as white."""


def picture_source(paths: Mapping[str, Path]) -> PictureSource:
    """Return what makes pictures of photos, from the paths of their images by `record_key`."""
    return partial(_pictures, paths)


def _pictures(paths: Mapping[str, Path], asked: Sequence[AskedImage]) -> list[GivenImage]:
    given: list[GivenImage] = []
    threads = available_threads()
    with stage("pictures", len(asked)) as advance:
        for first in range(0, len(asked), threads):
            given += by_threads(partial(_made, paths), asked[first : first + threads], 1)
            advance(len(given))
    return given


def _made(paths: Mapping[str, Path], asked: AskedImage) -> GivenImage:
    path = paths.get(record_key(asked.photo))
    if path is None:
        return GivenImage(fault="their images are missing or cannot be used")
    try:
        thumbnail = _thumbnail(path) if asked.thumbnail else ""
        return GivenImage(thumbnail, _chips(path, asked.chips) if len(asked.chips) else ())
    except InputError as error:
        return GivenImage(fault=error.complaints[0].message)


def _thumbnail(path: Path) -> str:
    header = read_header(path, path.name)
    longer = max(header.columns, header.rows)
    reduction = max(factor for factor in REDUCTIONS if factor == 1 or longer // factor >= _LONGER_SIDE)
    colours = read_colours(path, reduction, path.name)
    from PIL import Image  # there, where the pixels have been read

    picture = Image.fromarray(colours)
    picture.thumbnail((_LONGER_SIDE, _LONGER_SIDE), reducing_gap=2.0)
    while len(data := _jpeg(picture, THUMBNAIL_BYTES)) > THUMBNAIL_BYTES:
        picture = picture.resize((max(1, picture.width * 3 // 4), max(1, picture.height * 3 // 4)))
    return _address(data)


def _chips(path: Path, corners: IntArray) -> tuple[str, ...]:
    """Return the chips of an image; only their part of a TIFF is decoded."""
    columns, rows = corners.T
    top, left = int(rows.min()), int(columns.min())
    bottom, right = int(rows.max()) + CHIP_PIXELS, int(columns.max()) + CHIP_PIXELS
    grey = read_grey(path, ((top, bottom), (left, right)), shown=path.name)
    chips = (_chip(grey[row - top :, column - left :]) for column, row in corners.tolist())
    return tuple(_address(_jpeg(chip, CHIP_BYTES)) for chip in chips)


def _chip(grey: Grey) -> NDArray[np.uint8]:
    """Return a chip of 8 bits with all its contrast; what is beyond the image continues its edge."""
    part = grey[:CHIP_PIXELS, :CHIP_PIXELS]
    missing = [(0, CHIP_PIXELS - size) for size in part.shape]
    low, high = np.percentile(part, [_DARKEST, _BRIGHTEST])
    bright = (np.pad(part, missing, mode="edge") - float(low)) * (255.0 / max(float(high - low), 1.0))
    found: NDArray[np.uint8] = np.clip(np.rint(bright), 0, 255).astype(np.uint8)
    return found


def _jpeg(picture: NDArray[np.uint8] | Any, most: int) -> bytes:
    """Return a picture as JPEG of so many bytes at most, if any quality makes it so small; else the smallest."""
    data = b""
    for quality in _QUALITIES:
        data = jpeg_of(picture, quality=quality, optimize=True)
        if len(data) <= most:
            break
    return data


def _address(data: bytes) -> str:
    return f"data:image/jpeg;base64,{base64.b64encode(data).decode('ascii')}"
