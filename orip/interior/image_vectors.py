"""Image vectors: photo coordinates freed of the camera's distortion, as directions in the photo system."""

from __future__ import annotations

import math

import numpy as np

from orip.arrays import BoolArray, FloatArray, parts
from orip.geometry.projection import PROJECTIONS
from orip.interior.distortion import corrected_with_partials, remove_distortion
from orip.records.block import Block
from orip.structs import replace
from orip.threads import by_threads

_PLANE_UP_TO = math.radians(70.0)
"""Angle from the axis up to which a ray of a fisheye photo is compared in a plane image."""


def image_vectors(block: Block) -> FloatArray:
    """Return the image vectors of all photo points of a block, mm.

    Returns
    -------
    array (n, 3)
        (x, y, -C) of ideal coordinates reduced to the principal point; of an equidistant camera a vector of the length
        C in the direction of the ray, which may be more than 90 degrees from the axis. NaN where the distortion
        cannot be removed.
    """
    points = block.photo_points
    vectors = np.empty((len(points.photo), 3))

    def put(rows: slice) -> None:
        vectors[rows] = _vectors_at_once(replace(block, photo_points=points.of(rows)))

    by_threads(put, parts(len(points.photo)))
    return vectors


def _vectors_at_once(block: Block) -> FloatArray:
    points = block.photo_points
    camera = block.photo_camera[points.photo]
    parameters = np.array([record.parameters for record in block.cameras])
    distorting = parameters[:, 3:].any(axis=1)
    at_measured = np.array([record.distortion_at == "measured" for record in block.cameras])
    vectors = np.column_stack([points.xy - parameters[camera, 1:3], -parameters[camera, 0]])
    rows = np.flatnonzero((distorting & at_measured)[camera])
    corrected = corrected_with_partials(tuple(parameters[camera[rows], 3:].T), vectors[rows, 0], vectors[rows, 1])
    vectors[rows, :2] = np.stack(corrected[:2], axis=1)
    rows = np.flatnonzero((distorting & ~at_measured)[camera])
    vectors[rows, :2] = remove_distortion(vectors[rows, :2], parameters[camera[rows], 3:])
    rows = np.flatnonzero(are_equidistant(block))
    x, y, z = vectors[rows].T
    vectors[rows] = np.stack(PROJECTIONS["equidistant"].image_vector(-z, x, y), axis=1)
    return vectors


def suit_plane_image(vectors: FloatArray, is_equidistant: BoolArray) -> BoolArray:
    """Return which image vectors (n, 3) can be compared in a plane image: of fisheyes those near the axis."""
    near: BoolArray = -vectors[:, 2] > math.cos(_PLANE_UP_TO) * np.linalg.norm(vectors, axis=1)
    return ~is_equidistant | near


def are_equidistant(block: Block) -> BoolArray:
    """Return which photo points (n,) of a block are of cameras with equidistant projection."""
    cameras: BoolArray = np.array([camera.projection == "equidistant" for camera in block.cameras], dtype=bool)
    return cameras[block.photo_camera[block.photo_points.photo]]
