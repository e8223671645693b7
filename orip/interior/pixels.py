"""Pixels of digital frames and scans, and the millimetres that they stand for."""

from __future__ import annotations

import numpy as np

from orip.geometry.plane import PlaneTransformation
from orip.records.project.camera import Camera, Sensor
from orip.records.project.photo import Photo, Scan, Template


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


def pixel_size(
    photo: Photo, camera: Camera, template: Template | None, plate_to_photo: PlaneTransformation | None
) -> tuple[float, float] | None:
    """Return the size (mm) of a photo's pixels along its x and y axes, or None where it has neither sensor nor scan.

    Parameters
    ----------
    photo : Photo
    camera : Camera
    template : Template or None
        The template that the photo is on.
    plate_to_photo : PlaneTransformation or None
        How the photo lies in its scan: columns may run along its y axis. None, where that is not known, stands for an
        upright one.

    Notes
    -----
    Columns and rows are taken as equally precise, in pixels: where the photo lies askew, the size along an axis is the
    root of the square sum of what a column and a row contribute to it.
    """
    if camera.sensor is not None:
        sensor = camera.sensor
        return sensor.width / sensor.columns, sensor.height / sensor.rows
    scan = photo.scan or (template.scan if template else None)
    if scan is None or plate_to_photo is None:
        return scan.pixel if scan else None
    along_x, along_y = np.hypot(*(plate_to_photo.matrix * scan.pixel).T)
    return float(along_x), float(along_y)
