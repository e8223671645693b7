"""Cameras and exposure stations of image files, from what EXIF and XMP say: focal length, sensor, position, gimbal."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from types import MappingProxyType
from typing import Final, Literal

import numpy as np
from msgspec import Struct

from orip.files.exif import Exposure, ImageTags
from orip.records.control import NOT_GIVEN, Station
from orip.units import DEGREES_PER_RADIAN, RADIANS_PER_DEGREE

_DIAGONAL_35MM = math.hypot(36.0, 24.0)
_UNITS_MM = {2: 25.4, 3: 10.0, 4: 1.0, 5: 0.001}
"""Of FocalPlaneResolutionUnit: inch, cm, mm, micrometre."""

_CODE_ERRORS = (5.0, 5.0, 10.0)
"""Metres east, north, up, of positions without corrections, where the file has none."""

_ANGLE_ERRORS = (1.0 * RADIANS_PER_DEGREE, 1.0 * RADIANS_PER_DEGREE, 3.0 * RADIANS_PER_DEGREE)
_NADIR_PITCH = -math.pi / 2.0
_NO_ROLL = 0.1 * RADIANS_PER_DEGREE

SensorSource = Literal["--sensor-width", "table", "focal plane", "35 mm equivalent", "unknown"]
"""From which the size of a sensor is known."""

_KNOWN_WIDTHS: Final[Mapping[str, float]] = MappingProxyType(
    {
        "canon eos 5d mark ii": 36.0,
        "canon eos 5d mark iii": 36.0,
        "canon eos 5d mark iv": 36.0,
        "canon eos 6d": 35.8,
        "nikon d800": 35.9,
        "nikon d810": 35.9,
        "nikon d850": 35.9,
        "sony ilce-7rm2": 35.9,
        "sony ilce-6000": 23.5,
        "olympus optical co.,ltd c4040z": 7.176,
        "dji fc300x": 6.17,
        "dji fc330": 6.17,
        "dji fc220": 6.17,
        "dji fc6310": 13.2,
        "dji fc6310r": 13.2,
        "dji fc6310s": 13.2,
        "hasselblad l1d-20c": 13.2,
        "dji zenmusep1": 35.9,
    }
)
"""Widths of sensors (mm, the longer side) of makers' data sheets, by maker and model in EXIF.

They go before the resolution of the focal plane: that of some cameras is wrong by some per cent (EOS 5D Mark II: 37.1).
"""


class ImageCamera(Struct, frozen=True):
    """What tells the camera of an image: photos of equal ones are of one camera.

    Parameters
    ----------
    model, serial, lens : str
        Maker and model of the body, its serial number, the lens; empty where EXIF has none.
    focal_mm : float
        0 where it is not known.
    focal_px : float
        Focal length in pixels, to a tenth; 0 where it is not known.
    columns, rows : int
        Stored.
    width_mm : float
        Of the sensor's pixels along the columns; 0 where it is not known.
    source : SensorSource
        From which `width_mm` is known.
    """

    model: str
    serial: str
    lens: str
    focal_mm: float
    focal_px: float
    columns: int
    rows: int
    width_mm: float
    source: SensorSource


def camera_model(tags: ImageTags) -> str:
    """Return maker and model of the body, the maker once; empty where EXIF has none."""
    maker, model = (text_of(tags, tag) for tag in ("Image Make", "Image Model"))
    return (model if model.lower().startswith(maker.lower()) else f"{maker} {model}").strip()


def camera_of(tags: ImageTags, columns: int, rows: int, sensor_width: float | None = None) -> ImageCamera:
    """Return the camera of an image.

    Parameters
    ----------
    columns, rows : int
        Of the stored image.
    sensor_width : float or None
        mm, of the longer side of the sensor, where the user gives it.
    """
    model = camera_model(tags)
    focal_mm = number_of(tags, "EXIF FocalLength")
    focal_px, width = focal_length(tags, columns, rows)
    source: SensorSource = "focal plane" if number_of(tags, "EXIF FocalPlaneXResolution") > 0.0 else "35 mm equivalent"
    given = sensor_width if sensor_width is not None else _KNOWN_WIDTHS.get(model.lower())
    if given is not None:
        source = "table" if sensor_width is None else "--sensor-width"
        width = given * columns / max(columns, rows)
        if focal_mm > 0.0:
            focal_px = focal_mm / width * columns
    elif not width > 0.0:
        width, source = 0.0, "unknown"
    return ImageCamera(
        model, text_of(tags, "EXIF BodySerialNumber"), text_of(tags, "EXIF LensModel"),
        focal_mm if focal_mm > 0.0 else 0.0, round(focal_px, 1) if focal_px > 0.0 else 0.0, columns, rows,
        width, source,
    )  # fmt: skip


def focal_length(tags: ImageTags, columns: int, rows: int) -> tuple[float, float]:
    """Return the focal length in pixels, and the width of the sensor in mm, NaN where they are not known.

    From the focal length and the resolution of the sensor; else from that for 35 mm film, whose diagonal counts (CIPA
    DC-008).
    """
    focal_mm = number_of(tags, "EXIF FocalLength")
    resolution = number_of(tags, "EXIF FocalPlaneXResolution")
    unit = _UNITS_MM.get(whole_of(tags, "EXIF FocalPlaneResolutionUnit") or 2, math.nan)
    # an image that was made smaller keeps the resolution of the sensor
    width, length = number_of(tags, "EXIF ExifImageWidth"), number_of(tags, "EXIF ExifImageLength")
    # a program that turned the image may have left its sides as they were
    full, now = (max(width, length), max(columns, rows)) if length > 0.0 else (width, columns)
    scale = now / full if full > 0.0 else 1.0
    if focal_mm > 0.0 and resolution > 0.0 and math.isfinite(unit):
        pixel = unit / resolution / scale
        if 1e-4 < pixel < 0.1:
            return focal_mm / pixel, pixel * columns
    equivalent = number_of(tags, "EXIF FocalLengthIn35mmFilm")
    if equivalent > 0.0:
        focal_px = equivalent / _DIAGONAL_35MM * math.hypot(columns, rows)
        return focal_px, focal_mm / focal_px * columns if focal_mm > 0.0 else math.nan
    return math.nan, math.nan


def station_of(name: str, exposure: Exposure) -> Iterator[Station]:
    """Yield the position of an image, with the attitude of a gimbal that does not roll."""
    longitude, latitude, height = exposure.place
    if not math.isfinite(longitude + latitude + height):
        return
    is_fixed = exposure.quality == "fixed" and all(map(math.isfinite, exposure.errors))
    roll, pitch, yaw = exposure.angles
    is_level = math.isfinite(roll + pitch + yaw) and abs(roll) <= _NO_ROLL
    yield Station(
        name,
        (longitude * DEGREES_PER_RADIAN, latitude * DEGREES_PER_RADIAN, height),
        exposure.errors if is_fixed else _CODE_ERRORS,
        # a camera that looks down is one of a vehicle without pitch
        angles=(0.0, pitch - _NADIR_PITCH, yaw) if is_level else NOT_GIVEN,
        angle_error=_ANGLE_ERRORS if is_level else NOT_GIVEN,
        time=exposure.time,
    )


def utm_zone(places: np.ndarray) -> str:
    """Return the zone of UTM of places (n, 3), longitude and latitude in degrees."""
    longitude, latitude = np.median(places[:, :2], axis=0).tolist()
    zone = int((longitude + 180.0) % 360.0 // 6.0) + 1
    return f"EPSG:{(32600 if latitude >= 0.0 else 32700) + zone}"


def number_of(tags: ImageTags, name: str) -> float:
    """Return the first number of a tag; NaN if it has none."""
    values = getattr(tags.exif.get(name), "values", None) or [math.nan]
    try:
        first = values[0]
        if isinstance(first, tuple):  # what exifread makes of types with a floating point
            (first,) = first
        return float(first) if not isinstance(values, str) else math.nan
    except (TypeError, ValueError, ArithmeticError, LookupError):  # a damaged file may have anything there
        return math.nan


def whole_of(tags: ImageTags, name: str) -> int:
    """Return the first number of a tag as a whole one; 0 if it has none."""
    value = number_of(tags, name)
    return int(value) if math.isfinite(value) else 0


def text_of(tags: ImageTags, name: str) -> str:
    """Return the text of a tag on one line, at most 40 characters."""
    text = "".join(letter for letter in str(tags.exif.get(name, "")) if letter.isprintable())
    return " ".join(text.split())[:40]
