"""A gathered block without some of its photos, and without the points that only they saw."""

from __future__ import annotations

from collections.abc import Container
from dataclasses import replace
from itertools import compress

import numpy as np

from orip.arrays import BoolArray, IntArray
from orip.records.block import Block
from orip.records.control import ControlElement
from orip.records.names import record_key


def without_photos(block: Block, left_out: BoolArray) -> Block:
    """Return a gathered block without some photos, their rays, and the points and cameras that only they need.

    Parameters
    ----------
    block : Block
        As gathered: without starting coordinates of points, without theodolite sets.
    left_out : array (number of photos,) of bool

    Returns
    -------
    Block
        Points that never had a ray (the ends of distances and directions) stay.
    """
    points = block.photo_points
    rays = ~left_out[points.photo]
    lost = np.zeros(len(block.point_names), dtype=bool)
    lost[points.point] = True
    lost[points.point[rays]] = False
    photos = tuple(compress(block.photos, ~left_out))
    used = np.unique(block.photo_camera[~left_out])
    cameras = tuple(block.cameras[row] for row in used)
    names = tuple(compress(block.point_names, ~lost))
    kept, gone = set(names), set(compress(block.point_names, lost))
    datum_points = tuple(name for name in block.definition.datum_points if name not in gone)
    new_photo, new_point = _places(~left_out), _places(~lost)
    directions = tuple(each for each in block.directions if {each.station, each.target} <= kept)
    known = {
        "PHOTO": {record_key(photo.name) for photo in photos},
        "CAMERA": {record_key(camera.name) for camera in cameras},
        "POINT": kept,
        "THEODOLITE": {direction.set for direction in directions},
    }
    return replace(
        block,
        definition=replace(block.definition, datum_points=datum_points),
        cameras=cameras,
        photos=photos,
        photo_camera=np.searchsorted(used, block.photo_camera[~left_out]),
        photo_orientation=block.photo_orientation[~left_out],
        point_names=names,
        point_start=block.point_start[~lost],
        photo_points=replace(
            points,
            photo=new_photo[points.photo[rays]],
            point=new_point[points.point[rays]],
            xy=points.xy[rays],
            error=points.error[rays],
            used=points.used[rays],
        ),
        constant_points=block.constant_points[~lost],
        control_points=tuple(point for point in block.control_points if point.name in kept),
        elements=tuple(element for element in block.elements if _concerns(element, known[element.group])),
        distances=tuple(each for each in block.distances if {each.start, each.end} <= kept),
        directions=directions,
    )


def _places(kept: BoolArray) -> IntArray:
    """Return the new index of each of the kept; those of the others mean nothing."""
    return np.asarray(np.cumsum(kept) - 1, dtype=np.int64)


def _concerns(element: ControlElement, names: Container[str]) -> bool:
    is_record = element.group in ("PHOTO", "CAMERA")
    return (record_key(element.name) if is_record else element.name) in names
