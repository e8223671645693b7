"""Image coordinates as other programs count them, and orip's pixels: rows down, from the outer corner."""

from __future__ import annotations

import numpy as np

from orip.arrays import FloatArray
from orip.records.exchanged import ImageAxes


def pixels_from_axes(
    image: FloatArray, axes: ImageAxes, frame: tuple[int, int], sensor_mm: tuple[float, float] | None
) -> FloatArray:
    """Return columns and rows (n, 2) as orip counts them.

    Parameters
    ----------
    image : array (n, 2)
        In `axes`.
    axes : ImageAxes
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
