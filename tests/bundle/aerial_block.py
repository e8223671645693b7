"""An aerial block with many rays to a point, beside the scenes of `support.synthetic_block`."""

from __future__ import annotations

import zlib

import numpy as np
from scipy.spatial.transform import Rotation
from support.synthetic_block import SyntheticBlock

from orip.records.block import Block, IndexedPhotoPoints
from orip.records.observations.control import ControlPoint
from orip.records.project.camera import Camera
from orip.records.project.definition import BundleDefinition, Precision
from orip.records.project.photo import Photo

PRINCIPAL_DISTANCE_MM = 153.0
FRAME_MM = 230.0
PRECISION_MM = 0.005
CONTROL_ERROR = 0.05
_LEAST_RAYS = 4


def aerial_block(geometry: str, points_along_a_side: int = 9, **settings: object) -> SyntheticBlock:
    """Return a block without errors: three strips of five vertical photos, points of 4 to 15 rays.

    Overlap is 80 % along and 60 % across the strips, the flying height 1000 m above the ground. Every fourth point is
    weighted control of 5 cm.

    Parameters
    ----------
    geometry : str
        Seed of terrain and orientations.
    points_along_a_side : int
        Of a square grid over the block; points with fewer than four rays are left out.
    settings
        Of the bundle adjustment.
    """
    random = np.random.default_rng(zlib.crc32(f"aerial {geometry}".encode()))
    orientations = _orientations(random)
    side = np.linspace(-1.0, 1.0, points_along_a_side)
    x, y = np.meshgrid(600.0 + 1000.0 * side, 600.0 + 1100.0 * side)
    points = np.stack([x, y, 200.0 + 60.0 * random.uniform(size=x.shape)], axis=-1).reshape(-1, 3)
    camera = np.array([PRINCIPAL_DISTANCE_MM, 0.12, -0.07, *np.zeros(9)])
    ideal = _ideal(points, orientations)
    shown = (np.abs(ideal) < FRAME_MM / 2.0).all(axis=2)
    seen = shown.sum(axis=0) >= _LEAST_RAYS
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


def _orientations(random: np.random.Generator) -> np.ndarray:
    east, north = np.meshgrid(300.0 * np.arange(5.0), 600.0 * np.arange(3.0))
    result = np.zeros((east.size, 6))
    result[:, 0], result[:, 1], result[:, 2] = east.ravel(), north.ravel(), 1200.0
    return result + random.normal(size=result.shape) * [10.0, 10.0, 10.0, *np.radians([1.0, 1.0, 3.0])]


def _ideal(points: np.ndarray, orientations: np.ndarray) -> np.ndarray:
    """Return the images (photos, points, 2) from the principal point."""
    rotation = Rotation.from_euler("XYZ", orientations[:, 3:]).as_matrix()
    u = np.einsum("pkj,pik->pij", rotation, points[None] - orientations[:, None, :3])
    return -PRINCIPAL_DISTANCE_MM * u[:, :, :2] / u[:, :, 2:]
