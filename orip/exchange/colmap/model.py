"""A sparse model of COLMAP as its files hold it."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

import numpy as np
from msgspec import Struct, field
from numpy.typing import NDArray

from orip.arrays import FloatArray, IntArray
from orip.records.exchanged import Lens

NO_POINT = -1
"""Of a keypoint that belongs to no point."""

LARGEST_FRAME = 1_000_000
"""Columns or rows; more are a damaged file."""


class CameraModel(Struct, frozen=True):
    """A camera model of COLMAP: its number, its parameters, and the lens that it is.

    Parameters
    ----------
    number : int
    parameters : tuple of str
        In the order of the file, by the names of the lens; ``f`` is both focal lengths.
    lens : Lens
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
    id : int
    pose : tuple of 7 float
        Quaternion w, x, y, z and translation, from the world to the camera.
    camera : int
        Id of its camera.
    name : str
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


class ColmapModel(Struct, frozen=True):
    """A sparse model.

    Parameters
    ----------
    cameras : tuple of ColmapCamera
    images : tuple of ColmapImage
    points : ColmapPoints
    sensors_of_rigs : tuple of int
        Numbers of sensors of its rigs; empty for a model without them.
    """

    cameras: tuple[ColmapCamera, ...]
    images: tuple[ColmapImage, ...]
    points: ColmapPoints
    sensors_of_rigs: tuple[int, ...] = field(default=())


def no_points() -> ColmapPoints:
    """Return a model's points where there are none."""
    none = np.zeros(0, dtype=np.int64)
    return ColmapPoints(
        none, np.zeros((0, 3)), np.zeros((0, 3), dtype=np.uint8), np.zeros(0), none, np.zeros((0, 2), dtype=np.int64)
    )
