"""Starting coordinates of points: preliminary ones, else control, else the intersection of the rays that see them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from orip.arrays import BoolArray, FloatArray, IntArray, parts
from orip.errors import ProjectWarning
from orip.geometry.rays import RayMeeting, points_at_origins
from orip.geometry.rotation import rotation_from_angles
from orip.interior.image_coordinates import image_vectors
from orip.records.block import Block
from orip.records.observation_kinds import photos_per_point
from orip.structs import replace

_MOST_RAYS = 20_000
"""Rays from which it is told how far points typically are."""

_ROUNDING = 1e-9
"""Part of the largest coordinate; a point that is nearer than that to a projection centre coincides with it."""


def with_starting_points(block: Block) -> tuple[Block, list[ProjectWarning]]:
    """Return the block with starting coordinates: .PRE, else control, else the intersection of rays, else check points.

    Photos are in the local frame already; control and preliminary points have the project's coordinates.
    """
    start = block.point_start.copy()
    place = block.point_index()
    checks = np.full_like(start, np.nan)
    for point in block.control_points:
        if None not in point.coordinates:
            (checks if point.kind == "check" else start)[place[point.name]] = point.coordinates
    for given in block.preliminary:
        if given.name in place:
            start[place[given.name]] = given.coordinates
    start = block.ground.to_local(start)
    missing = np.isnan(start).any(axis=1)
    if missing.any():
        start[missing] = _intersections(block, start)[missing]
        # check points may have wrong coordinates: they start there only if their rays do not meet
        missing = np.isnan(start).any(axis=1)
        start[missing] = block.ground.to_local(checks)[missing]
    warnings = []
    single: NDArray[np.bool_] = np.asarray(np.isnan(start).any(axis=1))
    if single.any():
        start[single] = _points_on_first_ray(block, start, single)
        measured = block.photo_points
        in_use: BoolArray = measured.in_use
        rays = photos_per_point(measured.photo, measured.point, in_use, len(start))
        warnings = [
            ProjectWarning(
                "one-ray", f"point {block.point_names[index]}",
                f"{_seen(rays[index])} without preliminary coordinates: the distance from the photo is assumed",
            )
            for index in np.flatnonzero(single)
        ]  # fmt: skip
    _hold(block, start)
    return replace(block, point_start=start), warnings


def _seen(rays: int) -> str:
    return "is seen by one ray" if rays <= 1 else "is seen by rays that do not meet"


def _hold(block: Block, start: FloatArray) -> None:
    """Set the constant coordinates of the project to their given values."""
    rows = block.constant_points.any(axis=1)
    held = block.constant_points[rows]
    project = block.ground.to_project(start[rows])
    project[held] = given_coordinates(block)[rows][held]
    start[rows] = block.ground.to_local(project)


def _rays(block: Block, rotation: FloatArray, rows: slice | IntArray) -> tuple[FloatArray, FloatArray]:
    """Return origins and directions (k, 3) of the rays of some photo points, with the rotations of all photos."""
    points = block.photo_points.of(rows)
    vectors = image_vectors(replace(block, photo_points=points))
    return block.photo_orientation[points.photo, :3], np.einsum("nij,nj->ni", rotation[points.photo], vectors)


def _intersections(block: Block, known: FloatArray) -> FloatArray:
    """Return where rays meet (number of points, 3), NaN where they do not; `known` coordinates tell how far points are.

    Rays from one place are no intersection.
    """
    photo, point, centres = block.photo_points.photo, block.photo_points.point, block.photo_orientation[:, :3]
    rotation, seen = rotation_from_angles(block.photo_orientation[:, 3:]), block.photo_points.in_use
    meeting = RayMeeting(centres.mean(axis=0), len(block.point_names))
    for rows in parts(len(photo)):
        origins, directions = _rays(block, rotation, rows)
        chosen = seen[rows]
        chosen &= np.isfinite(directions).all(axis=1)
        meeting.add(origins[chosen], directions[chosen], point[rows][chosen])
    found = meeting.positions()
    typical = _typical_distance(found if np.isnan(known).all() else known, block)
    near = np.zeros(len(found), dtype=bool)
    for rows in parts(len(photo)):
        points = point[rows][seen[rows]]
        near[points_at_origins(found, centres[photo[rows][seen[rows]]], points, typical)] = True
    found[near] = np.nan
    return found


def _typical_distance(positions: FloatArray, block: Block) -> float:
    """Return the median distance of points from their photos, those at a centre left out; 1 if none is known.

    In a large block that of an even selection of its rays.
    """
    points, centres = block.photo_points, block.photo_orientation[:, :3]
    rays = slice(None, None, 1 + len(points.photo) // _MOST_RAYS)
    distances = np.linalg.norm(positions[points.point[rays]] - centres[points.photo[rays]], axis=1)
    distances = distances[distances > _ROUNDING * np.abs(centres).max(initial=1.0)]
    return float(np.median(distances)) if len(distances) else 1.0


def _points_on_first_ray(block: Block, start: FloatArray, wanted: NDArray[np.bool_]) -> FloatArray:
    """Return positions of points without coordinates: on their first ray, at the median distance of the others."""
    indices, first = np.unique(block.photo_points.point, return_index=True)
    of_wanted = wanted[indices]
    origins, directions = _rays(block, rotation_from_angles(block.photo_orientation[:, 3:]), first[of_wanted])
    directions = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    position = np.full_like(start, np.nan)
    position[indices[of_wanted]] = origins + _typical_distance(start, block) * directions
    return np.asarray(position[wanted])


def given_coordinates(block: Block) -> FloatArray:
    """Return the project's coordinates (number of points, 3) of control and constant elements; NaN for others."""
    place = block.point_index()
    given = np.full((len(block.point_names), 3), np.nan)
    for point in block.control_points:
        if not point.rejected:
            given[place[point.name]] = [np.nan if value is None else value for value in point.coordinates]
    for element in block.elements:
        if element.group == "POINT" and element.error == 0.0:
            given[place[element.name], "XYZ".index(element.kind)] = element.value
    return given
