"""What another program is given besides the result: control and observed positions, and photos on film as pixels."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from orip.arrays import FloatArray
from orip.exchange.format import PIXEL_MM
from orip.exchange.sources.names import NamesTable
from orip.geometry.ground_frame import GroundFrame
from orip.interior.image_coordinates import sensor_transformation
from orip.records.camera import Camera, Sensor
from orip.records.coded_names import rows_of_records
from orip.records.control import NOT_GIVEN, ControlPoint, Station, StationReference
from orip.records.names import record_key
from orip.structs import replace
from orip.wording import counted
from orip.workflow.project.bundle_state import BundleState


def cameras_with_frames(
    bundle: BundleState, cameras: Mapping[str, Camera], camera_of_photo: Mapping[str, str]
) -> dict[str, Camera]:
    """Return cameras, by `record_key`, of which those without a sensor have one that holds their photo coordinates.

    It lies about the origin of the fiducial system.
    """
    reach = {key: np.zeros(2) for key, camera in cameras.items() if camera.sensor is None}
    for photo, rows in rows_of_records(bundle.observations.photos).items():
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
    cameras : mapping of record_key to Camera
        As `cameras_with_frames` returns them.
    camera_of_photo : mapping of record_key to record_key
    """
    pixels = bundle.observations.measured.copy()
    for photo, rows in rows_of_records(bundle.observations.photos).items():
        key = camera_of_photo.get(photo)
        sensor = None if key is None else cameras[key].sensor
        to_photo = bundle.interior.to_photo.get(photo)
        if key is None or sensor is None or to_photo is None or bundle.records.cameras[key].sensor is not None:
            continue
        to_pixels = sensor_transformation(sensor).inverse()
        pixels[rows] = to_pixels.apply(to_photo.apply(pixels[rows]))
    return pixels


def given_control(
    bundle: BundleState, names: NamesTable, frame: GroundFrame | None, height: float
) -> tuple[ControlPoint, ...]:
    """Return the control points of a project.

    Parameters
    ----------
    frame : GroundFrame or None
        None: coordinates stay those of the project. Else X and Y of a point without one of them are left out.
    height : float
        Of the project, at which points without a height are taken to the frame.
    """
    points = [
        replace(point, name=names.original_mark(point.name))
        for point in bundle.control.points
        if frame is None or None not in point.coordinates[:2]
    ]
    if frame is None or not points:
        return tuple(points)
    places = [[height if value is None else value for value in point.coordinates] for point in points]
    return tuple(
        replace(point, coordinates=(x, y, None if point.coordinates[2] is None else z))
        for point, (x, y, z) in zip(points, frame.to_local(np.array(places)).tolist(), strict=True)
    )


def given_stations(
    bundle: BundleState, names: NamesTable, frame: GroundFrame | None
) -> tuple[tuple[Station, ...], StationReference, tuple[str, ...]]:
    """Return the observed positions of photos, what they refer to, and sentences about what is left out.

    Those in another system than the project's are left out, as are angles where the frame is not the project's system.
    """
    control = bundle.control
    reference = control.station_reference
    given = [station for station in control.stations if station.has_position]
    if reference.crs and given:
        notes = (f"{counted(len(given), 'observed position')} of photos in {reference.crs} left out.",)
        return (), StationReference(), notes
    stations = [replace(one, photo=names.photos.get(record_key(one.photo), one.photo)) for one in given]
    if frame is None or not stations:
        return tuple(stations), StationReference(navigation=reference.navigation), ()
    places: FloatArray = frame.to_local(np.array([station.position for station in stations]))
    moved = [
        replace(station, position=(x, y, z), angles=NOT_GIVEN, angle_error=NOT_GIVEN, covariance=None, motion=None)
        for station, (x, y, z) in zip(stations, places.tolist(), strict=True)
    ]
    return tuple(moved), StationReference(), ()
