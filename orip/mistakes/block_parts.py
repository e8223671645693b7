"""A block without one of its photos, and without cameras that it has no photo of."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from orip.records.block import Block, IndexedPhotoPoints
from orip.records.repeated import photos_per_point


def without_photo(block: Block, photo: int) -> Block:
    """Return a block without a photo, its photo points, and the tie points that fewer than two photos show then.

    Parameters
    ----------
    block : Block
    photo : int
        Its index in the block.
    """
    points = block.photo_points
    used = (points.photo != photo) & points.used.all(axis=1)
    known = {point.name for point in block.control_points if point.kind == "control"}
    known |= {name for distance in block.distances for name in (distance.start, distance.end)}
    known |= {name for direction in block.directions for name in (direction.station, direction.target)}
    rays = photos_per_point(points.photo, points.point, used, len(block.point_names))
    kept = np.array([rays[row] > 1 or (name in known) for row, name in enumerate(block.point_names)])
    return without_unused_cameras(_of(block, np.arange(len(block.photos)) != photo, kept))


def without_unmeasured_points(block: Block) -> Block:
    """Return a block without the points that no photo shows, and what is observed of them."""
    shown = np.zeros(len(block.point_names), dtype=bool)
    shown[block.photo_points.point] = True
    return _of(block, np.ones(len(block.photos), dtype=bool), shown)


def without_unused_cameras(block: Block) -> Block:
    """Return a block without the cameras that none of its photos has."""
    used = np.unique(block.photo_camera)
    place = np.full(len(block.cameras), -1)
    place[used] = np.arange(len(used))
    return replace(block, cameras=tuple(block.cameras[k] for k in used), photo_camera=place[block.photo_camera])


def _of(block: Block, photos: np.ndarray, points: np.ndarray) -> Block:
    """Return a block of some photos and points (bool), and what is observed of these alone."""
    measured = block.photo_points
    rows = photos[measured.photo] & points[measured.point]
    new_photo, new_point = np.cumsum(photos) - 1, np.cumsum(points) - 1
    names = tuple(name for name, keep in zip(block.point_names, points, strict=True) if keep)
    records = tuple(photo for photo, keep in zip(block.photos, photos, strict=True) if keep)
    there = set(names)
    gone = {photo.name for photo in block.photos} - {photo.name for photo in records}
    return replace(
        block,
        photos=records,
        photo_camera=block.photo_camera[photos],
        photo_orientation=block.photo_orientation[photos],
        point_names=names,
        point_start=block.point_start[points],
        photo_points=IndexedPhotoPoints(
            new_photo[measured.photo[rows]],
            new_point[measured.point[rows]],
            measured.xy[rows],
            measured.error[rows],
            measured.used[rows],
        ),
        constant_points=block.constant_points[points],
        control_points=tuple(point for point in block.control_points if point.name in there),
        elements=tuple(
            element
            for element in block.elements
            if not (element.group == "PHOTO" and element.name in gone)
            and not (element.group == "POINT" and element.name not in there)
        ),
        distances=tuple(line for line in block.distances if {line.start, line.end} <= there),
        directions=tuple(line for line in block.directions if {line.station, line.target} <= there),
        constant_elements=tuple(
            element for element in block.constant_elements if element.name in there or element.group == "CAMERA"
        ),
    )
