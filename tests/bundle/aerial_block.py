"""An aerial block with many rays to a point, beside the scenes of `support.synthetic_block`."""

from __future__ import annotations

import zlib

import numpy as np
from msgspec import Struct
from scipy.spatial.transform import Rotation
from support.synthetic_block import SyntheticBlock

from orip.records.block import Block, IndexedPhotoPoints
from orip.records.camera import Camera
from orip.records.control import ControlPoint
from orip.records.definition import BundleDefinition, Precision
from orip.records.photo import Photo

PRINCIPAL_DISTANCE_MM = 153.0
FRAME_MM = 230.0
PRECISION_MM = 0.005
CONTROL_ERROR = 0.05
_SIDE = 1500.0
"""Of a photo on the ground."""


class Flight(Struct, frozen=True):
    """Photos in strips, their overlap along and across these, and the fewest rays of a point."""

    strips: int = 3
    photos: int = 5
    along: float = 0.8
    across: float = 0.6
    least_rays: int = 4

    @property
    def extent(self) -> np.ndarray:
        """Return how far the last photo is from the first one, east and north."""
        return _SIDE * np.array([(1.0 - self.along) * (self.photos - 1), (1.0 - self.across) * (self.strips - 1)])


_USUAL = Flight()


def aerial_block(
    geometry: str, points_along_a_side: int = 9, flight: Flight = _USUAL, **settings: object
) -> SyntheticBlock:
    """Return a block without errors: as a rule three strips of five vertical photos, points of 4 to 15 rays.

    The flying height is 1000 m above the ground. Every fourth point is weighted control of 5 cm.

    Parameters
    ----------
    geometry : str
        Seed of terrain and orientations.
    points_along_a_side : int
        Of a square grid over the block; points with too few rays are left out.
    flight : Flight
    settings
        Of the bundle adjustment.
    """
    random = np.random.default_rng(zlib.crc32(f"aerial {geometry}".encode()))
    orientations = _orientations(random, flight)
    side, middle = np.linspace(-1.0, 1.0, points_along_a_side), flight.extent / 2.0
    x, y = np.meshgrid(middle[0] + (middle[0] + 400.0) * side, middle[1] + (middle[1] + 500.0) * side)
    points = np.stack([x, y, 200.0 + 60.0 * random.uniform(size=x.shape)], axis=-1).reshape(-1, 3)
    camera = np.array([PRINCIPAL_DISTANCE_MM, 0.12, -0.07, *np.zeros(10)])
    ideal = _ideal(points, orientations)
    shown = (np.abs(ideal) < FRAME_MM / 2.0).all(axis=2)
    seen = shown.sum(axis=0) >= flight.least_rays
    points = points[seen]
    photo, point = np.nonzero(shown[:, seen])
    xy = camera[1:3] + ideal[:, seen][photo, point]
    names = tuple(str(101 + number) for number in range(len(points)))
    block = Block(
        definition=BundleDefinition(geometry, Precision(PRECISION_MM), **settings),
        cameras=(Camera("CAM", tuple(camera.tolist()), frame=(FRAME_MM, FRAME_MM)),),
        photos=tuple(
            Photo(f"P{row + 1}", "CAM", orientation=tuple(np.r_[orientation[:3], np.degrees(orientation[3:])].tolist()))
            for row, orientation in enumerate(orientations)
        ),
        photo_camera=np.zeros(len(orientations), dtype=np.int64),
        photo_orientation=orientations.copy(),
        point_names=names,
        point_start=points.copy(),
        photo_points=IndexedPhotoPoints(
            photo, point, xy, np.full(xy.shape, PRECISION_MM), np.ones(xy.shape, dtype=bool)
        ),
        constant_points=np.zeros((len(points), 3), dtype=bool),
        control_points=tuple(
            ControlPoint(names[index], tuple(points[index].tolist()), (CONTROL_ERROR,) * 3)
            for index in range(0, len(points), 4)
        ),
    )
    return SyntheticBlock(block, camera[None], orientations, points)


def _orientations(random: np.random.Generator, flight: Flight) -> np.ndarray:
    east, north = np.meshgrid(
        np.linspace(0.0, flight.extent[0], flight.photos), np.linspace(0.0, flight.extent[1], flight.strips)
    )
    result = np.zeros((east.size, 6))
    result[:, 0], result[:, 1], result[:, 2] = east.ravel(), north.ravel(), 1200.0
    return result + random.normal(size=result.shape) * [10.0, 10.0, 10.0, *np.radians([1.0, 1.0, 3.0])]


def _ideal(points: np.ndarray, orientations: np.ndarray) -> np.ndarray:
    """Return the images (photos, points, 2) from the principal point."""
    rotation = Rotation.from_euler("XYZ", orientations[:, 3:]).as_matrix()
    u = np.einsum("pkj,pik->pij", rotation, points[None] - orientations[:, None, :3])
    return -PRINCIPAL_DISTANCE_MM * u[:, :, :2] / u[:, :, 2:]
