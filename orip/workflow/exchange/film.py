"""Photos on film, for formats that measure in millimetres: pixels of a small size stand for photo coordinates."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from orip.arrays import FloatArray
from orip.exchange.sources.assumed_frame import PIXEL_MM
from orip.interior.image_coordinates import sensor_transformation
from orip.records.names import record_key
from orip.records.project.camera import Camera, Sensor
from orip.structs import replace
from orip.workflow.project.bundle_state import BundleState


def cameras_with_frames(
    bundle: BundleState, cameras: Mapping[str, Camera], camera_of_photo: Mapping[str, str]
) -> dict[str, Camera]:
    """Return cameras, by `record_key`, of which those without a sensor have one that holds their photo coordinates.

    It lies about the origin of the fiducial system.
    """
    reach = {key: np.zeros(2) for key, camera in cameras.items() if camera.sensor is None}
    for photo, rows in _rows_of_photos(bundle).items():
        camera = camera_of_photo.get(photo)
        to_photo = bundle.interior.to_photo.get(photo)
        if camera in reach and to_photo is not None:
            found = np.abs(to_photo.apply(bundle.observations.measured[rows])).max(axis=0)
            reach[camera] = np.maximum(reach[camera], found)
    return {
        key: camera if key not in reach else replace(camera, fiducials=(), sensor=_frame(camera, reach[key]))
        for key, camera in cameras.items()
    }


def _frame(camera: Camera, reach: FloatArray) -> Sensor:
    sides = [reach, *(np.abs([mark.x, mark.y]) for mark in camera.fiducials), np.full(2, 5.0)]
    columns, rows = (max(1, round(2.0 * side / PIXEL_MM)) for side in np.ceil(np.max(sides, axis=0)).tolist())
    return Sensor(columns, rows, columns * PIXEL_MM, rows * PIXEL_MM)


def measured_pixels(
    bundle: BundleState, cameras: Mapping[str, Camera], camera_of_photo: Mapping[str, str]
) -> FloatArray:
    """Return the measurements (n, 2) of a bundle in pixels: as they are of digital photos, else as the frame has them.

    Parameters
    ----------
    bundle : BundleState
    cameras : mapping of record_key to Camera
        As `cameras_with_frames` returns them.
    camera_of_photo : mapping of record_key to record_key
    """
    pixels = bundle.observations.measured.copy()
    for photo, rows in _rows_of_photos(bundle).items():
        key = camera_of_photo.get(photo)
        sensor = None if key is None else cameras[key].sensor
        to_photo = bundle.interior.to_photo.get(photo)
        if key is None or sensor is None or to_photo is None or bundle.records.cameras[key].sensor is not None:
            continue
        to_pixels = sensor_transformation(sensor).inverse()
        pixels[rows] = to_pixels.apply(to_photo.apply(pixels[rows]))
    return pixels


def _rows_of_photos(bundle: BundleState) -> dict[str, list[int]]:
    found: dict[str, list[int]] = {}
    for row, name in enumerate(bundle.observations.photos):
        found.setdefault(record_key(name), []).append(row)
    return found
