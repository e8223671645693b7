"""Pixels of digital frames and scans, and the millimetres that they stand for."""

from __future__ import annotations

import numpy as np

from orip.geometry.plane import PlaneTransformation
from orip.model.camera import Camera, Sensor
from orip.model.photo import Photo, Scan, Template


def sensor_transformation(sensor: Sensor) -> PlaneTransformation:
    """Return the transformation from pixels (outer corner of the upper left pixel, rows down) to photo millimetres."""
    x_pixel, y_pixel = sensor.width / sensor.columns, sensor.height / sensor.rows
    return PlaneTransformation(
        np.array([[x_pixel, 0.0], [0.0, -y_pixel]]), np.array([-sensor.width / 2.0, sensor.height / 2.0])
    )


def scan_transformation(scan: Scan) -> PlaneTransformation:
    """Return the transformation from scan pixels (column right, row down) to plate millimetres (y up)."""
    x_pixel, y_pixel = scan.pixel
    to_corner = 0.5 if scan.origin == "centre" else 0.0
    return PlaneTransformation(
        np.array([[x_pixel, 0.0], [0.0, -y_pixel]]), np.array([to_corner * x_pixel, -to_corner * y_pixel])
    )


def pixel_size(photo: Photo, camera: Camera, template: Template | None) -> tuple[float, float] | None:
    """Return the pixel size (mm, x and y) of a photo's sensor or scan, or None where it has neither."""
    if camera.sensor is not None:
        sensor = camera.sensor
        return sensor.width / sensor.columns, sensor.height / sensor.rows
    scan = photo.scan or (template.scan if template else None)
    return scan.pixel if scan else None
