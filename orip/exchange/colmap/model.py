"""A sparse model of COLMAP as its files hold it, and the positions of photos in its database."""

from __future__ import annotations

import math
import sqlite3
from collections.abc import Iterator, Mapping
from contextlib import closing
from pathlib import Path
from types import MappingProxyType
from typing import Final

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from orip.arrays import FloatArray, IntArray
from orip.errors import Complaint
from orip.files.text.decimal_numbers import LARGEST_NUMBER
from orip.files.text.shown import Parsed, printable
from orip.records.control import IN_PROJECT, Station, StationReference
from orip.records.exchanged import Lens

NO_POINT = -1
"""Of a keypoint that belongs to no point."""

LARGEST_FRAME = 1_000_000
"""Columns or rows; more are a damaged file."""

CAMERA_SENSOR = 0
"""Kind of a sensor that is a camera."""

Pose = tuple[float, ...]
"""Quaternion w, x, y, z and translation."""

IDENTITY: Pose = (1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


def is_pose(pose: Pose) -> bool:
    """Return whether numbers are a pose: a binary file may have any, and squares of some of them are none."""
    return all(abs(value) <= LARGEST_NUMBER for value in pose) and any(abs(q) >= 1.0 / LARGEST_NUMBER for q in pose[:4])


class CameraModel(Struct, frozen=True):
    """A camera model of COLMAP: its number, its parameters, and the lens that it is.

    Parameters
    ----------
    parameters : tuple of str
        In the order of the file, by the names of the lens; ``f`` is both focal lengths.
    """

    number: int
    parameters: tuple[str, ...]
    lens: Lens


_ONE, _TWO = ("f", "cx", "cy"), ("fx", "fy", "cx", "cy")

CAMERA_MODELS: Final[Mapping[str, CameraModel]] = MappingProxyType(
    {
        "SIMPLE_PINHOLE": CameraModel(0, _ONE, "opencv"),
        "PINHOLE": CameraModel(1, _TWO, "opencv"),
        "SIMPLE_RADIAL": CameraModel(2, (*_ONE, "k1"), "opencv"),
        "RADIAL": CameraModel(3, (*_ONE, "k1", "k2"), "opencv"),
        "OPENCV": CameraModel(4, (*_TWO, "k1", "k2", "p1", "p2"), "opencv"),
        "OPENCV_FISHEYE": CameraModel(5, (*_TWO, "k1", "k2", "k3", "k4"), "equidistant"),
        "FULL_OPENCV": CameraModel(6, (*_TWO, "k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"), "opencv"),
        "FOV": CameraModel(7, (*_TWO, "omega"), "fov"),
        "SIMPLE_RADIAL_FISHEYE": CameraModel(8, (*_ONE, "k1"), "equidistant"),
        "RADIAL_FISHEYE": CameraModel(9, (*_ONE, "k1", "k2"), "equidistant"),
        "THIN_PRISM_FISHEYE": CameraModel(10, (*_TWO, "k1", "k2", "p1", "p2", "k3", "k4", "s1", "s3"), "equidistant"),
        # counted from 0 there, the decentring terms in the other order
        "RAD_TAN_THIN_PRISM_FISHEYE": CameraModel(
            11, (*_TWO, "k1", "k2", "k3", "k4", "k5", "k6", "p2", "p1", "s1", "s2", "s3", "s4"), "fisheye624"
        ),
        "SIMPLE_DIVISION": CameraModel(12, (*_ONE, "k1"), "division"),
        "DIVISION": CameraModel(13, (*_TWO, "k1"), "division"),
        "SIMPLE_FISHEYE": CameraModel(14, _ONE, "equidistant"),
        "FISHEYE": CameraModel(15, _TWO, "equidistant"),
        "EUCM": CameraModel(16, (*_TWO, "alpha", "beta"), "eucm"),
        "EQUIRECTANGULAR": CameraModel(17, ("w", "h"), "unsupported"),
    }
)

MODEL_NAMES: Final[Mapping[int, str]] = MappingProxyType({model.number: name for name, model in CAMERA_MODELS.items()})


class ColmapCamera(Struct, frozen=True):
    """A camera: its id, the name of its model, the size of its frame in pixels and its parameters."""

    id: int
    model: str
    columns: int
    rows: int
    parameters: tuple[float, ...]


class ColmapImage(Struct, frozen=True):
    """An image that is registered.

    Parameters
    ----------
    pose : tuple of 7 float
        Quaternion w, x, y, z and translation, from the world to the camera.
    camera : int
        Id of its camera.
    keypoints : array (k, 2)
        Columns and rows from the outer corner of the upper left pixel.
    points : array (k,) of int
        Ids of their points; `NO_POINT`: none.
    """

    id: int
    pose: tuple[float, ...]
    camera: int
    name: str
    keypoints: FloatArray
    points: IntArray


class ColmapPoints(Struct, frozen=True):
    """m points.

    Parameters
    ----------
    ids : array (m,) of int
    coordinates : array (m, 3)
    colours : array (m, 3) of uint8
    errors : array (m,)
        Mean length of the residuals of a point's rays, pixels; -1 where it was never computed.
    lengths : array (m,) of int
        Numbers of rays.
    tracks : array (sum of lengths, 2) of int
        Ids of images, and places among their keypoints, of all points one after the other.
    """

    ids: IntArray
    coordinates: FloatArray
    colours: NDArray[np.uint8]
    errors: FloatArray
    lengths: IntArray
    tracks: IntArray


class ColmapRig(Struct, frozen=True):
    """Sensors on one body, the reference first.

    Parameters
    ----------
    sensors : tuple of (int, int)
        Kind and id of each; cameras are of the kind `CAMERA_SENSOR`.
    poses : tuple of (tuple of 7 float, or None)
        From the rig to the sensor, as of images; None where it is not known.
    """

    id: int
    sensors: tuple[tuple[int, int], ...]
    poses: tuple[Pose | None, ...]


class ColmapFrame(Struct, frozen=True):
    """What the sensors of a rig took at one instant: kind of sensor, its id and that of the datum, or image.

    The pose is from the world to the rig.
    """

    id: int
    rig: int
    pose: Pose
    data: tuple[tuple[int, int, int], ...]


class ColmapModel(Struct, frozen=True):
    """A sparse model."""

    cameras: tuple[ColmapCamera, ...]
    images: tuple[ColmapImage, ...]
    points: ColmapPoints
    rigs: tuple[ColmapRig, ...] = ()
    frames: tuple[ColmapFrame, ...] = ()


def no_points() -> ColmapPoints:
    """Return a model's points where there are none."""
    none = np.zeros(0, dtype=np.int64)
    return ColmapPoints(
        none, np.zeros((0, 3)), np.zeros((0, 3), dtype=np.uint8), np.zeros(0), none, np.zeros((0, 2), dtype=np.int64)
    )


# The table has had two forms: up to COLMAP 3.x a row belongs to an image, from 4.x on to the datum of a sensor. Columns
# are found by their names. What is NaN is not given.


DATABASE = "database.db"
_LEVELS = 3
"""The model is in its project's folder, or in sparse/0 of it."""

_WGS84, _CARTESIAN = 0, 1
_GEOGRAPHIC = "EPSG:4979"
_LARGEST = 1e8
_LONGEST_VALUE = 1 << 20
_INSTRUCTIONS, _MOST_STEPS = 100_000, 5_000
"""Of SQLite's machine, between two looks, and how many looks: some ten million rows, and some seconds."""


class PosePriors(Struct, frozen=True):
    """Stations of photos by their image names, what their positions refer to, and what is lost."""

    stations: tuple[Station, ...] = ()
    reference: StationReference = IN_PROJECT
    notes: tuple[str, ...] = ()


def pose_priors(model: Path) -> Parsed[PosePriors]:
    """Return the positions of photos in the database beside a model; none where there is no database.

    Parameters
    ----------
    model : Path
        Folder of the model.
    """
    folder = model.absolute()
    found = next(
        (level / DATABASE for level in [folder, *folder.parents][:_LEVELS] if (level / DATABASE).is_file()), None
    )
    if found is None:
        return Parsed(PosePriors())
    try:
        with closing(sqlite3.connect(f"{found.as_uri()}?mode=ro&immutable=1", uri=True)) as connection:
            _confine(connection)
            return Parsed(_priors(connection))
    except (sqlite3.Error, ValueError, OverflowError) as fault:
        reason = "it takes longer than all of a large project" if "interrupted" in str(fault) else str(fault)
        message = (
            f"the positions of photos in it cannot be read ({printable(reason)}); move it away, and they are left out"
        )
        return Parsed(PosePriors(), (Complaint(message, str(found)),))


def _confine(connection: sqlite3.Connection) -> None:
    """Let nothing in a database do more than be read: it may be made by anybody."""
    connection.execute("PRAGMA trusted_schema = OFF")
    connection.execute("PRAGMA temp_store = MEMORY")
    connection.execute("PRAGMA cell_size_check = ON")
    connection.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, _LONGEST_VALUE)
    connection.setlimit(sqlite3.SQLITE_LIMIT_ATTACHED, 0)
    left = iter(range(_MOST_STEPS))
    connection.set_progress_handler(lambda: next(left, -1) < 0, _INSTRUCTIONS)


def _columns(connection: sqlite3.Connection, table: str) -> list[str]:
    """Return the names of the columns of a table; none where there is no such table.

    Raises
    ------
    ValueError
        If it is a view or a virtual table, or has computed columns: what they do has no bounds.
    """
    for kind, statement in connection.execute(
        "SELECT type, sql FROM sqlite_master WHERE name = ? COLLATE NOCASE AND type <> 'index'", (table,)
    ).fetchall():
        if kind != "table" or "VIRTUAL" in str(statement).upper().split()[:2]:
            message = f"'{table}' in it is no plain table, as COLMAP makes it"
            raise ValueError(message)
    rows = connection.execute(f"PRAGMA table_xinfo({table})").fetchall()
    if any(row[-1] for row in rows):
        message = f"'{table}' in it has a computed column, as COLMAP makes none"
        raise ValueError(message)
    return [str(row[1]) for row in rows]


def _priors(connection: sqlite3.Connection) -> PosePriors:
    columns = _columns(connection, "pose_priors")
    if "position" not in columns or "coordinate_system" not in columns:
        return PosePriors()
    rows = _rows(connection, columns)
    given = [row for row in rows if row[1] in {_WGS84, _CARTESIAN}]
    systems = {row[1] for row in given}
    if len(systems) != 1:
        reason = "their coordinate system is not stated" if not systems else "they are in two coordinate systems"
        return PosePriors(notes=(f"Positions of photos in {DATABASE} are left out: {reason}.",) if rows else ())
    is_geographic = systems == {_WGS84}
    stations = tuple(_stations(given, is_geographic=is_geographic))
    notes = []
    if any(station.position_error[0] < 0.0 for station in stations):
        notes.append(
            f"Positions of photos in {DATABASE} have no standard deviations: they are compared, and have no influence."
        )
    return PosePriors(stations, StationReference(_GEOGRAPHIC) if is_geographic else IN_PROJECT, tuple(notes))


def _rows(connection: sqlite3.Connection, columns: list[str]) -> list[tuple[object, ...]]:
    """Return name, system, position and covariance of each image with a position, in the order of the images.

    Each table is read by itself, from its beginning to its end: a join has no bounds.
    """
    images: dict[object, object] = {}
    _columns(connection, "images")
    for image, name in connection.execute("SELECT image_id, name FROM images"):
        if image in images:
            message = f"image {image} is there twice"
            raise ValueError(message)
        images[image] = name
    is_new = "corr_data_id" in columns
    covariance = "position_covariance" if "position_covariance" in columns else "NULL"
    sensor = "corr_sensor_type" if is_new and "corr_sensor_type" in columns else str(CAMERA_SENSOR)
    found: dict[object, tuple[object, ...]] = {}
    for image, of_sensor, *row in connection.execute(
        f"SELECT {'corr_data_id' if is_new else 'image_id'}, {sensor}, coordinate_system, position, {covariance} "
        "FROM pose_priors"
    ):
        if of_sensor != CAMERA_SENSOR or image not in images:
            continue
        if image in found:
            message = f"the position of image {image} is there twice"
            raise ValueError(message)
        found[image] = (images[image], *row)
    return [found[image] for image in images if image in found]


def _stations(rows: list[tuple[object, ...]], *, is_geographic: bool) -> Iterator[Station]:
    for name, _, position, covariance in rows:
        place = _floats(position, 3)
        if place is None or not np.isfinite(place).all() or np.abs(place).max() > _LARGEST:
            continue
        if is_geographic:
            place = place[[1, 0, 2]]
        errors = (-1.0, -1.0, -1.0)
        matrix = _floats(covariance, 9)
        if matrix is not None:
            variances = matrix.reshape(3, 3).diagonal()
            if np.isfinite(variances).all() and (variances > 0.0).all():
                x, y, z = map(math.sqrt, variances.tolist())
                errors = (x, y, z)
        x, y, z = place.tolist()
        yield Station(str(name), (x, y, z), errors)


def _floats(blob: object, count: int) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]] | None:
    if not isinstance(blob, bytes) or len(blob) != 8 * count:
        return None
    return np.frombuffer(blob, "<f8").astype(np.float64)
