"""Image files themselves: cameras and photos from EXIF, positions and gimbal angles from EXIF and XMP of DJI.

Columns and rows are those of the stored image, whatever the orientation tag says of how it is to be shown.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from msgspec import Struct, field

from orip.errors import Complaint
from orip.files.exif import (
    DAMAGED,
    MOST_IMAGES,
    Exposure,
    ImageTags,
    exposure_of,
    image_files,
    image_tags,
)
from orip.files.image_cameras import camera_model, focal_length, station_of, utm_zone, whole_of
from orip.files.text.regular_file import open_regular
from orip.files.text.shown import Parsed
from orip.records.control import StationReference
from orip.records.exchanged import ExchangedCamera, ExchangedPhoto, ExchangedPoints, ExchangedProject, ExchangedRays
from orip.wording import agreeing, counted, first_names

_MOST_NAMED = 3
_OF_FOCAL_LENGTH, _UNKNOWN_FOCAL_LENGTH = 0.03, 0.3
"""Standard deviation over the focal length: cameras round it to whole millimetres, and focus changes it; and of one
that no tag says."""
_OF_PRINCIPAL_POINT = 0.015
"""Standard deviation over the number of columns."""
_OF_DISTORTION = {"k1": 0.2, "k2": 0.2}
"""Standard deviations of a lens that is not a fisheye."""

_HEAD = 32
_FRAMES = (*range(0xC0, 0xC4), *range(0xC5, 0xC8), *range(0xC9, 0xCC), *range(0xCD, 0xD0))
"""Markers of JPEG that have the size of the image."""


class _Image(Struct, frozen=True):
    """An image: its file, what a camera is recognised by, focal length (pixels), width of the sensor (mm), tags.

    Focal length and width are NaN where they are not known.
    """

    name: str
    camera: tuple[str, int, int, str]
    focal_px: float
    width_mm: float
    is_turned: bool
    exposure: Exposure


class _Read(Struct):
    images: list[_Image] = field(default_factory=list)
    complaints: list[Complaint] = field(default_factory=list)


def is_images(source: Path) -> bool:
    """Return whether a folder has image files, and nothing else that a format is recognised by."""
    if not source.is_dir():
        return False
    found = [path for path in source.iterdir() if not path.name.startswith(".")]
    return bool(found) and set(found) == set(image_files(source))


def read_images_project(source: Path, shown: str) -> Parsed[ExchangedProject | None]:
    """Read the image files of a folder; no measurements are in them, and no orientations but those of gimbals."""
    if not source.is_dir():
        return Parsed(None, (Complaint("name the folder of the image files", shown),))
    paths = image_files(source)
    if not paths:
        return Parsed(None, (Complaint("the folder has no image file", shown),))
    found = _Read()
    for path in paths[:MOST_IMAGES]:
        _add(path, found)
    if found.complaints:
        return Parsed(None, tuple(found.complaints))
    cameras = _cameras(found.images)
    stations = tuple(station for image in found.images for station in station_of(image.name, image.exposure))
    places = np.array([station.position for station in stations if station.has_position]).reshape(-1, 3)
    return Parsed(
        ExchangedProject(
            "",
            tuple(cameras.values()),
            tuple(
                ExchangedPhoto(image.name, list(cameras).index(image.camera), key=n)
                for n, image in enumerate(found.images)
            ),
            ExchangedPoints((), np.zeros((0, 3)), np.zeros(0, dtype=np.bool_)),
            ExchangedRays(
                *(np.zeros(0, dtype=np.int64),) * 2, np.zeros((0, 2)), np.zeros(0), np.zeros(0, dtype=np.bool_)
            ),
            stations=stations if len(places) else (),
            station_reference=StationReference("EPSG:4979", navigation=True),
            crs=utm_zone(places) if len(places) else None,
            ground_unit="m" if len(places) else "unit",
            notes=tuple(_notes(found.images, places)),
        )
    )


def _add(path: Path, found: _Read) -> None:
    try:
        tags = image_tags(path)
        columns, rows = _size(path, tags)
        exposure = exposure_of(tags)
        focal_px, width_mm = focal_length(tags, columns, rows)
    except DAMAGED as fault:
        message = f"its data cannot be read ({type(fault).__name__}); take the file out of the folder"
        found.complaints.append(Complaint(message, path.name))
        return
    if not (columns and rows):
        message = "its number of columns and rows is not in it; take the file out of the folder"
        found.complaints.append(Complaint(message, path.name))
        return
    kind = (camera_model(tags), columns, rows, f"{focal_px:.1f}")
    is_turned = whole_of(tags, "Image Orientation") not in (0, 1)
    found.images.append(_Image(path.name, kind, focal_px, width_mm, is_turned, exposure))


def _cameras(images: Sequence[_Image]) -> dict[tuple[str, int, int, str], ExchangedCamera]:
    """Return a camera for all images of one model, size and focal length."""
    found: dict[tuple[str, int, int, str], ExchangedCamera] = {}
    for image in images:
        model, columns, rows, _ = image.camera
        is_known = math.isfinite(image.focal_px)
        focal = image.focal_px if is_known else float(max(columns, rows))
        parameters = {"fx": focal, "fy": focal, "cx": columns / 2.0, "cy": rows / 2.0}
        width = image.width_mm
        sensor = (width, width * rows / columns) if math.isfinite(width) else None
        share = _OF_FOCAL_LENGTH if is_known else _UNKNOWN_FOCAL_LENGTH
        middle = _OF_PRINCIPAL_POINT * columns
        deviations = {"f": share * focal, "cx": middle, "cy": middle, **_OF_DISTORTION}
        found.setdefault(
            image.camera,
            ExchangedCamera(
                model or "camera",
                columns,
                rows,
                "opencv",
                parameters,
                "EXIF",
                sensor_mm=sensor,
                free=tuple(deviations),
                deviations=deviations,
            ),
        )
    return found


def _notes(images: Sequence[_Image], places: np.ndarray) -> Iterator[str]:
    without = [image.name for image in images if not math.isfinite(image.focal_px)]
    if without:
        yield (
            f"{counted(len(without), 'image')} without a focal length in EXIF ({first_names(without, _MOST_NAMED)}): "
            "the longer side of the image was taken for it; correct c in [[camera]]."
        )
    turned = [image.name for image in images if image.is_turned]
    if turned:
        yield (
            f"{counted(len(turned), 'image')} {agreeing(len(turned), 'has', 'have')} an orientation tag "
            f"({first_names(turned, _MOST_NAMED)}): columns and rows are those of the stored image, not of the view "
            "that programs turn by the tag."
        )
    unplaced = len(images) - len(places)
    if not len(places):
        yield "No image has a position: no coordinates are imported, and the project has no crs."
        return
    if unplaced:
        yield f"{counted(unplaced, 'image')} without a position in EXIF or XMP."
    yield (
        f"Positions are longitude, latitude and height of EXIF or XMP in the .STA file, and count as ellipsoidal; the "
        f"project's crs is the zone of UTM, {utm_zone(places)}: change it to the system that results are wanted in."
    )


def _size(path: Path, tags: ImageTags) -> tuple[int, int]:
    """Return columns and rows of the stored image: of its own head, else of EXIF; 0 where they are not known."""
    with open_regular(path) as file:
        head = file.read(_HEAD)
        if head.startswith(b"\x89PNG\r\n\x1a\n") and len(head) >= 24:
            columns, rows = struct.unpack(">2I", head[16:24])
            return int(columns), int(rows)
        if head.startswith(b"\xff\xd8"):
            place = 2
            while True:
                file.seek(place)
                marker = file.read(9)
                if len(marker) < 9 or marker[0] != 0xFF:
                    break
                if marker[1] in _FRAMES:
                    rows, columns = struct.unpack(">2H", marker[5:9])
                    return int(columns), int(rows)
                place += 2 + int.from_bytes(marker[2:4], "big")
    for names in (("EXIF ExifImageWidth", "EXIF ExifImageLength"), ("Image ImageWidth", "Image ImageLength")):
        columns, rows = (whole_of(tags, name) for name in names)
        if 0 < columns < 1 << 20 and 0 < rows < 1 << 20:
            return columns, rows
    return 0, 0
