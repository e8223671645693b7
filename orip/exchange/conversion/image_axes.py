"""Image coordinates as other programs count them, and cameras of theirs that orip cannot hold."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from orip.arrays import FloatArray
from orip.errors import OripError
from orip.exchange.conversion.lens_exact import Parameters
from orip.exchange.conversion.lens_table import focal_lengths, lens_parameters
from orip.records.camera import Sensor
from orip.records.exchanged import PIXELS, ExchangedCamera, ImageAxes, Lens

_FOCAL_LENGTHS = (1e-3, 1e9)  # pixels or mm; beyond, powers of the focal length are no numbers any more


_OBLONG, _NEAR_THE_MIDDLE = 0.15, 0.03
"""Parts of the longer side: what the sides of an oblong frame differ by at least, so that the middles of both positions
are 0.07 apart; and what principal points of ordinary cameras are off the middle."""


class UnsuitableCameraError(OripError):
    """Orip has no camera that comes near enough."""

    exit_code = 3


def named(source: ExchangedCamera) -> str:
    """Return how a camera is called in messages: as its file has it."""
    return f"camera '{source.name}' ({source.model})" if source.model else f"camera '{source.name}'"


def require_possible(source: ExchangedCamera) -> None:
    """Refuse a camera whose lens, frame or values cannot be those of a camera of orip.

    Raises
    ------
    UnsuitableCameraError
    """
    what = named(source)
    if source.lens == "unsupported":
        message = (
            f"{what}: orip has perspective and fisheye lenses with polynomial distortion, and this is neither; "
            "calibrate the camera as one of these in the other program"
        )
        raise UnsuitableCameraError(message)
    if source.columns <= 0 or source.rows <= 0:
        message = f"{what}: the number of its columns and rows is not known; give it with --frame COLUMNSxROWS"
        raise UnsuitableCameraError(message)
    focal, shortest, longest = focal_lengths(source), *_FOCAL_LENGTHS
    if (
        not all(np.isfinite(list(lens_parameters(source).values())))
        or not shortest <= min(focal) <= max(focal) <= longest
    ):
        message = (
            f"{what}: its focal length is not between {shortest:g} and {longest:g} {source.lens_axes.unit}, or a "
            "parameter is not finite"
        )
        raise UnsuitableCameraError(message)
    if _is_frame_exchanged(source):
        message = (
            f"{what}: its principal point is in the middle of a frame of {source.rows} x {source.columns} pixels, and "
            f"not of one of {source.columns} x {source.rows}: width and height are probably exchanged; exchange them"
        )
        raise UnsuitableCameraError(message)


def _is_frame_exchanged(source: ExchangedCamera) -> bool:
    """Tell whether the principal point is in the middle of a frame that lies the other way."""
    parameters, longer = lens_parameters(source), max(source.frame)
    # from the middle of the frame a principal point says nothing of its sides
    if source.lens_axes != PIXELS or "cx" not in parameters:
        return False
    off = max(abs(parameters["cx"] - 0.5 * source.rows), abs(parameters["cy"] - 0.5 * source.columns))
    return longer - min(source.frame) > _OBLONG * longer and off < _NEAR_THE_MIDDLE * longer


def pixels_from_axes(
    image: FloatArray, axes: ImageAxes, frame: tuple[int, int], sensor_mm: tuple[float, float] | None
) -> FloatArray:
    """Return columns and rows (n, 2) as orip counts them.

    Parameters
    ----------
    image : array (n, 2)
        In `axes`.
    frame : tuple of 2 int
        Columns and rows.
    sensor_mm : tuple of 2 float, or None
        Width and height; needed for axes in mm.
    """
    scale, shift = _to_pixels(axes, frame, sensor_mm)
    return image * scale + shift


def axes_from_pixels(
    pixels: FloatArray, axes: ImageAxes, frame: tuple[int, int], sensor_mm: tuple[float, float] | None
) -> FloatArray:
    """Return image coordinates (n, 2) in axes of orip's columns and rows; parameters as of `pixels_from_axes`."""
    scale, shift = _to_pixels(axes, frame, sensor_mm)
    return np.asarray((pixels - shift) / scale)


def _to_pixels(
    axes: ImageAxes, frame: tuple[int, int], sensor_mm: tuple[float, float] | None
) -> tuple[FloatArray, FloatArray]:
    size = np.array(frame, dtype=np.float64)
    scale = np.ones(2)
    if axes.unit == "mm":
        if sensor_mm is None:
            message = "coordinates in mm need the size of the sensor"
            raise ValueError(message)
        scale = size / np.array(sensor_mm)
    if axes.y == "up":
        scale = scale * np.array([1.0, -1.0])
    shift = {"corner": np.zeros(2), "first_pixel": np.full(2, 0.5), "frame_centre": size / 2.0}[axes.origin]
    return scale, shift


# Unequal focal lengths of OpenCV and b1 of Metashape stretch the distorted image along x. Orip's B1 stretches the ideal
# one. Measured in square pixels, columns being multiplied by fy / fx, the image of these lenses has no such affinity.

_SQUARE = 1e-12
"""By which sides of pixels differ that are equal: the sensor's size was divided by the numbers of columns and rows."""

_FX: frozenset[Lens] = frozenset(("opencv", "equidistant", "fisheye624", "fov", "eucm", "angle_polynomial"))
_B1: frozenset[Lens] = frozenset(("agisoft", "agisoft_fisheye"))


def has_aspect(lens: Lens) -> bool:
    """Return whether a lens has an affinity along x that follows its distortion."""
    return lens in _FX or lens in _B1


def pixel_aspect(lens: Lens, p: Parameters) -> float:
    """Return the width of a lens' pixels in their heights; 1 where this is no property of the lens."""
    if lens in _FX:
        return p["fy"] / p["fx"]
    wide = p["f"] + p["b1"] if lens in _B1 else 0.0
    return p["f"] / wide if wide else 1.0


def in_square_pixels(lens: Lens, p: Mapping[str, float], middle: float) -> dict[str, float]:
    """Return the parameters of a lens for columns that are multiplied by its `pixel_aspect` from a middle column."""
    aspect = pixel_aspect(lens, p)
    found = {**p, "cx": middle + (p["cx"] - middle) * aspect}
    if lens in _FX:
        return {**found, "fx": p["fy"]}
    return {**found, "b1": 0.0, "b2": p["b2"] * aspect} if lens in _B1 else dict(p)


def in_given_pixels(lens: Lens, p: Mapping[str, float], aspect: float, middle: float) -> dict[str, float]:
    """Return the parameters of a lens for columns divided by an aspect, the inverse of `in_square_pixels`."""
    found = {**p, "cx": middle + (p["cx"] - middle) / aspect}
    if lens in _FX:
        return {**found, "fx": p["fx"] / aspect}
    if lens in _B1:
        return {**found, "b1": (p["f"] + p["b1"]) / aspect - p["f"], "b2": p["b2"] / aspect}
    return dict(p)


def aspect_of_sensor(sensor: Sensor, lens: Lens, axes: ImageAxes) -> tuple[float, float]:
    """Return the aspect of a sensor's pixels that a lens can have, and the size of a pixel, mm."""
    width, height = sensor.width / sensor.columns, sensor.height / sensor.rows
    is_aspect_of_lens = has_aspect(lens) and axes.unit == "pixel" and abs(width / height - 1.0) > _SQUARE
    return (width / height, height) if is_aspect_of_lens else (1.0, width)


def stretched_image(image: FloatArray, aspect: float, middle: float) -> FloatArray:
    """Return image coordinates (n, 2) with x multiplied by an aspect from a middle column."""
    return np.asarray((image - [middle, 0.0]) * [aspect, 1.0] + [middle, 0.0])
