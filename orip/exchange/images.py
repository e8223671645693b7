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
from orip.files.text.regular_file import open_regular
from orip.files.text.shown import Parsed
from orip.records.control import NOT_GIVEN, Station, StationReference
from orip.records.exchanged import ExchangedCamera, ExchangedPhoto, ExchangedPoints, ExchangedProject, ExchangedRays
from orip.units import DEGREES_PER_RADIAN, RADIANS_PER_DEGREE
from orip.wording import agreeing, counted, first_names

_MOST_NAMED = 3
_DIAGONAL_35MM = math.hypot(36.0, 24.0)
_UNITS_MM = {2: 25.4, 3: 10.0, 4: 1.0, 5: 0.001}
"""Of FocalPlaneResolutionUnit: inch, cm, mm, micrometre."""

_CODE_ERRORS = (5.0, 5.0, 10.0)
"""Metres east, north, up, of positions without corrections, where the file has none."""

_ANGLE_ERRORS = (1.0 * RADIANS_PER_DEGREE, 1.0 * RADIANS_PER_DEGREE, 3.0 * RADIANS_PER_DEGREE)
_NADIR_PITCH = -math.pi / 2.0
_NO_ROLL = 0.1 * RADIANS_PER_DEGREE

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
    stations = tuple(station for image in found.images for station in _station(image))
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
            crs=_utm(places) if len(places) else None,
            ground_unit="m" if len(places) else "unit",
            notes=tuple(_notes(found.images, places)),
        )
    )


def _add(path: Path, found: _Read) -> None:
    try:
        tags = image_tags(path)
        columns, rows = _size(path, tags)
        exposure = exposure_of(tags)
        focal_px, width_mm = _focal_length(tags, columns, rows)
    except DAMAGED as fault:
        message = f"its data cannot be read ({type(fault).__name__}); take the file out of the folder"
        found.complaints.append(Complaint(message, path.name))
        return
    if not (columns and rows):
        message = "its number of columns and rows is not in it; take the file out of the folder"
        found.complaints.append(Complaint(message, path.name))
        return
    maker, model = (_text(tags, tag) for tag in ("Image Make", "Image Model"))
    name = model if model.lower().startswith(maker.lower()) else f"{maker} {model}"
    kind = (name.strip(), columns, rows, f"{focal_px:.1f}")
    is_turned = _whole(tags, "Image Orientation") not in (0, 1)
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


def _focal_length(tags: ImageTags, columns: int, rows: int) -> tuple[float, float]:
    """Return the focal length in pixels, and the width of the sensor in mm, NaN where they are not known.

    From the focal length and the resolution of the sensor; else from that for 35 mm film, whose diagonal counts (CIPA
    DC-008).
    """
    focal_mm = _number(tags, "EXIF FocalLength")
    resolution = _number(tags, "EXIF FocalPlaneXResolution")
    unit = _UNITS_MM.get(_whole(tags, "EXIF FocalPlaneResolutionUnit") or 2, math.nan)
    # an image that was made smaller keeps the resolution of the sensor
    width, length = _number(tags, "EXIF ExifImageWidth"), _number(tags, "EXIF ExifImageLength")
    # a program that turned the image may have left its sides as they were
    full, now = (max(width, length), max(columns, rows)) if length > 0.0 else (width, columns)
    scale = now / full if full > 0.0 else 1.0
    if focal_mm > 0.0 and resolution > 0.0 and math.isfinite(unit):
        pixel = unit / resolution / scale
        if 1e-4 < pixel < 0.1:
            return focal_mm / pixel, pixel * columns
    equivalent = _number(tags, "EXIF FocalLengthIn35mmFilm")
    if equivalent > 0.0:
        focal_px = equivalent / _DIAGONAL_35MM * math.hypot(columns, rows)
        return focal_px, focal_mm / focal_px * columns if focal_mm > 0.0 else math.nan
    return math.nan, math.nan


def _station(image: _Image) -> Iterator[Station]:
    """Yield the position of an image, with the attitude of a gimbal that does not roll."""
    longitude, latitude, height = image.exposure.place
    if not math.isfinite(longitude + latitude + height):
        return
    is_fixed = image.exposure.quality == "fixed" and all(map(math.isfinite, image.exposure.errors))
    roll, pitch, yaw = image.exposure.angles
    is_level = math.isfinite(roll + pitch + yaw) and abs(roll) <= _NO_ROLL
    yield Station(
        image.name,
        (longitude * DEGREES_PER_RADIAN, latitude * DEGREES_PER_RADIAN, height),
        image.exposure.errors if is_fixed else _CODE_ERRORS,
        # a camera that looks down is one of a vehicle without pitch
        angles=(0.0, pitch - _NADIR_PITCH, yaw) if is_level else NOT_GIVEN,
        angle_error=_ANGLE_ERRORS if is_level else NOT_GIVEN,
        time=image.exposure.time,
    )


def _utm(places: np.ndarray) -> str:
    """Return the zone of UTM of places (n, 3), longitude and latitude in degrees."""
    longitude, latitude = np.median(places[:, :2], axis=0).tolist()
    zone = int((longitude + 180.0) % 360.0 // 6.0) + 1
    return f"EPSG:{(32600 if latitude >= 0.0 else 32700) + zone}"


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
        f"project's crs is the zone of UTM, {_utm(places)}: change it to the system that results are wanted in."
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
        columns, rows = (_whole(tags, name) for name in names)
        if 0 < columns < 1 << 20 and 0 < rows < 1 << 20:
            return columns, rows
    return 0, 0


def _number(tags: ImageTags, name: str) -> float:
    """Return the first number of a tag; NaN if it has none."""
    values = getattr(tags.exif.get(name), "values", None) or [math.nan]
    return float(values[0]) if not isinstance(values, str) else math.nan


def _whole(tags: ImageTags, name: str) -> int:
    value = _number(tags, name)
    return int(value) if math.isfinite(value) else 0


def _text(tags: ImageTags, name: str) -> str:
    text = "".join(letter for letter in str(tags.exif.get(name, "")) if letter.isprintable())
    return " ".join(text.split())[:40]
