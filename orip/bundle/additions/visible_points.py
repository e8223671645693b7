"""Which points photos show: those within their frames."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from orip.arrays import FloatArray, IntArray
from orip.geometry.rotation import rotation_from_angles
from orip.records.block import Block, IndexedPhotoPoints
from orip.records.camera import Camera
from orip.structs import replace

_EDGE = 0.02
"""Part of the frame at each side in which no tie point is expected."""

_STEEP = 1.3
"""Radians from the vertical within which all that a photo shows is near it."""


def with_rays(block: Block, error: FloatArray) -> Block:
    """Return a block of one camera with its points in all photos whose frame they are in.

    Parameters
    ----------
    error : array (2,)
        A-priori errors of x and y, mm.
    """
    camera = block.cameras[0]
    half = (0.5 - _EDGE) * _size(camera)
    places_near = _nearby(block, half)
    rotations = rotation_from_angles(block.photo_orientation[:, 3:])
    photo, point, image = [], [], []
    for row, (centre, rotation) in enumerate(zip(block.photo_orientation[:, :3], rotations, strict=True)):
        near = places_near(row)
        u = (block.point_start[near] - centre) @ rotation
        front = u[:, 2] < 0.0
        xy = -camera.parameters[0] * u[:, :2] / np.where(front, u[:, 2], -np.inf)[:, None]
        shown = np.flatnonzero(front & (np.abs(xy) <= half).all(axis=1))
        photo.append(np.full(len(shown), row))
        point.append(near[shown])
        image.append(xy[shown])
    photos, points = np.concatenate(photo), np.concatenate(point)
    xy = np.concatenate(image) + camera.parameters[1:3]
    return replace(
        block,
        photo_points=IndexedPhotoPoints(
            photos, points, xy, np.broadcast_to(error, xy.shape).copy(), np.ones(xy.shape, dtype=bool)
        ),
    )


def _nearby(block: Block, half: FloatArray) -> Callable[[int], IntArray]:
    """Return what gives the points that a photo may show: all but those behind the plane through its centre.

    Photos that look down steeply show nothing that is far from below them; of large blocks that is most.
    """
    from scipy.spatial import KDTree

    camera, centres = block.cameras[0], block.photo_orientation[:, :3]
    down = rotation_from_angles(block.photo_orientation[:, 3:])[:, 2, 2]
    widest = np.arctan(np.hypot(*half) / camera.parameters[0])
    steepest = np.arccos(np.clip(down, -1.0, 1.0)) + widest
    depth = centres[:, 2] - block.point_start[:, 2].min()
    if not (steepest < _STEEP).all():
        return lambda _: np.arange(len(block.point_start))
    tree = KDTree(block.point_start[:, :2])
    found = tree.query_ball_point(centres[:, :2], np.maximum(depth, 0.0) * np.tan(steepest), return_sorted=True)
    return lambda row: np.array(found[row], dtype=np.int64)


def _size(camera: Camera) -> FloatArray:
    """Return the size (2,) of the frame, mm."""
    size = camera.sensor.size if camera.sensor is not None else camera.frame
    assert size is not None, "photos are planned with cameras that have one"
    return np.array(size)
