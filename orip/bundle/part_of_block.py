"""A part of a block: some of its photos and points, and what is observed of these alone."""

from __future__ import annotations

from collections.abc import Callable
from itertools import compress

import numpy as np

from orip.arrays import BoolArray, IntArray
from orip.records.block import Block, IndexedPhotoPoints
from orip.records.names import record_key
from orip.records.observations.control import ControlElement
from orip.records.observations.repeated import photos_per_point
from orip.structs import replace


def part_of_block(block: Block, photos: BoolArray, points: BoolArray) -> Block:
    """Return a block of some photos and points, the cameras of these photos, and what is observed of these alone.

    Parameters
    ----------
    block : Block
    photos : array (number of photos,) of bool
        True: stays.
    points : array (number of points,) of bool
        True: stays.
    """
    cameras = np.unique(block.photo_camera[photos])
    names = frozenset(compress(block.point_names, points))
    gone = frozenset(compress(block.point_names, ~points))
    directions = tuple(line for line in block.directions if {line.station, line.target} <= names)
    sets = {line.set for line in directions}
    shown = {record_key(photo.name) for photo in compress(block.photos, photos)}
    part = replace(
        block,
        definition=replace(
            block.definition, datum_points=tuple(name for name in block.definition.datum_points if name not in gone)
        ),
        cameras=tuple(block.cameras[row] for row in cameras),
        photos=tuple(compress(block.photos, photos)),
        photo_camera=np.searchsorted(cameras, block.photo_camera[photos]),
        photo_orientation=block.photo_orientation[photos],
        point_names=tuple(compress(block.point_names, points)),
        point_start=block.point_start[points],
        photo_points=_rays(block.photo_points, photos, points),
        constant_points=block.constant_points[points],
        control_points=tuple(point for point in block.control_points if point.name in names),
        distances=tuple(line for line in block.distances if {line.start, line.end} <= names),
        directions=directions,
        stations=tuple(station for station in block.stations if record_key(station.photo) in shown),
        theodolites=tuple(station for station in block.theodolites if station.name in sets),
    )
    concerns = _concerns(part)
    return replace(
        part,
        elements=tuple(filter(concerns, block.elements)),
        constant_elements=tuple(filter(concerns, block.constant_elements)),
    )


def without_photos(block: Block, left_out: BoolArray) -> Block:
    """Return a block without some photos, and without the points that they alone show.

    Points that no photo shows (the ends of distances and directions) stay.

    Parameters
    ----------
    block : Block
    left_out : array (number of photos,) of bool
    """
    shown = _is_shown(block)
    return part_of_block(block, ~left_out, ~shown | _is_shown(block, ~left_out[block.photo_points.photo]))


def without_photo(block: Block, photo: int) -> Block:
    """Return a block without a photo, and without the tie points that are then in fewer than two photos.

    Parameters
    ----------
    block : Block
    photo : int
        Its index in the block.
    """
    points = block.photo_points
    used = (points.photo != photo) & points.in_use
    known = {point.name for point in block.control_points if point.kind == "control"}
    known |= {name for distance in block.distances for name in (distance.start, distance.end)}
    known |= {name for direction in block.directions for name in (direction.station, direction.target)}
    rays = photos_per_point(points.photo, points.point, used, len(block.point_names))
    kept = np.array([rays[row] > 1 or (name in known) for row, name in enumerate(block.point_names)])
    return part_of_block(block, np.arange(len(block.photos)) != photo, kept)


def without_unmeasured_points(block: Block) -> Block:
    """Return a block without the points that no photo shows, and what is observed of them."""
    return part_of_block(block, np.ones(len(block.photos), dtype=bool), _is_shown(block))


def without_unused_cameras(block: Block) -> Block:
    """Return a block without the cameras that none of its photos has."""
    return part_of_block(block, np.ones(len(block.photos), dtype=bool), np.ones(len(block.point_names), dtype=bool))


def _is_shown(block: Block, rays: BoolArray | slice = slice(None)) -> BoolArray:
    """Return which points (number of points,) have one of these rays."""
    shown = np.zeros(len(block.point_names), dtype=bool)
    shown[block.photo_points.point[rays]] = True
    return shown


def _rays(measured: IndexedPhotoPoints, photos: BoolArray, points: BoolArray) -> IndexedPhotoPoints:
    rows = photos[measured.photo] & points[measured.point]
    return IndexedPhotoPoints(
        _places(photos)[measured.photo[rows]],
        _places(points)[measured.point[rows]],
        measured.xy[rows],
        measured.error[rows],
        measured.used[rows],
    )


def _places(kept: BoolArray) -> IntArray:
    """Return the new index of each row that is kept; the others have no valid one."""
    return np.asarray(np.cumsum(kept) - 1, dtype=np.int64)


def _concerns(part: Block) -> Callable[[ControlElement], bool]:
    """Return a test of whether an element belongs to a photo, camera, point or theodolite set of a block."""
    known = {
        "PHOTO": {record_key(photo.name) for photo in part.photos},
        "CAMERA": {record_key(camera.name) for camera in part.cameras},
        "POINT": set(part.point_names),
        "THEODOLITE": {line.set for line in part.directions},
    }

    def concerns(element: ControlElement) -> bool:
        is_record = element.group in ("PHOTO", "CAMERA")
        return (record_key(element.name) if is_record else element.name) in known[element.group]

    return concerns
