"""What a session has, as documents of JSON: photos, points, cameras, residuals and statistics."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from orip.geometry.rotation import angles_from_rotation, rotation_from_angles
from orip.online.held_control import control_as_given
from orip.online.measuring import Measuring
from orip.online.online_block import OnlineBlock
from orip.records.project.camera import CAMERA_PARAMETERS
from orip.records.project.photo import PHOTO_PARAMETERS
from orip.sequential.standing import falls, redundancies

Shown = dict[str, Any]


@contextmanager
def _at_solution(measuring: Measuring) -> Iterator[OnlineBlock]:
    """Yield the block of a session near its solution with the control as the project gives it, held where it is."""
    measuring.reconsider()
    with control_as_given(measuring.block):
        measuring.approach_solution()
        yield measuring.block


def photos_of(measuring: Measuring) -> list[Shown]:
    """Return all photos in which something is measured: elements in project units and degrees, or what is missing."""
    with _at_solution(measuring) as block:
        orientations, _ = block.at_solution()
    values = block.values
    oriented = {name: orientations[name] for name in block.measurements.photos if name in orientations}
    elements = {}
    if oriented:
        local = np.array(list(oriented.values()))
        centres = block.ground.to_project(local[:, :3])
        rotations = block.ground.axes_at(centres) @ rotation_from_angles(local[:, 3:])
        degrees = np.degrees(angles_from_rotation(rotations))
        elements = dict(zip(oriented, np.hstack([centres, degrees]).tolist(), strict=True))
    return [
        {
            "photo": name,
            "points": len(block.measurements.points_in(name)),
            "included": len(block.included_of(photos=[name])),
            "waits": "" if name in oriented else values.photos_wait.get(name, ""),
            **(dict(zip(PHOTO_PARAMETERS, elements[name], strict=True)) if name in oriented else {}),
        }
        for name in block.measurements.photos
    ]


def points_of(measuring: Measuring) -> list[Shown]:
    """Return all points that are measured: coordinates in the project, or what is missing, and numbers of rays."""
    with _at_solution(measuring) as block:
        _, points = block.at_solution()
    values = block.values
    placed = {name: found for name in block.measurements.points if (found := points.get(name)) is not None}
    places = block.ground.to_project(np.array(list(placed.values())).reshape(-1, 3)).tolist()
    coordinates = dict(zip(placed, places, strict=True))
    return [
        {
            "point": name,
            "rays": len(block.measurements.photos_of(name)),
            "included": sum(key.kind == "photo" for key in block.included_of(points=[name])),
            "waits": "" if name in placed else values.points_wait.get(name, ""),
            **(dict(zip("XYZ", coordinates[name], strict=True)) if name in placed else {}),
        }
        for name in block.measurements.points
    ]


def cameras_of(measuring: Measuring) -> list[Shown]:
    """Return all cameras with the parameters that measuring goes on with, mm, and which are unknown to `solve`."""
    measuring.approach_solution()
    block = measuring.block
    return [
        {
            "camera": camera.name,
            "unknown": list(camera.unknown),
            "adjusted": camera.name in block.values.cameras,
            **dict(zip(CAMERA_PARAMETERS, block.values.cameras.get(camera.name, camera.parameters), strict=True)),
        }
        for camera in block.measurements.inputs.records.cameras.values()
    ]


def residuals_of(measuring: Measuring, photo: str = "", point: str = "") -> list[Shown]:
    """Return the photo points that are in: residuals and redundancy numbers of x and y, w and its limit, largest first.

    Residuals are computed minus observed, divided by the a-priori errors.

    Parameters
    ----------
    measuring : Measuring
    photo, point : str
        Those of this photo alone, as it is defined, and of this point; empty: of all.
    """
    equations = measuring.block.equations
    of_both = measuring.block.included_of([photo] if photo else (), [point] if point else ())
    keys = [
        key
        for key in (of_both if photo or point else equations.included)
        if key.kind == "photo" and photo in ("", key.photo) and point in ("", key.point)
    ]
    standings = equations.standings(keys)
    squares, checked = falls(standings)
    limits = {count: measuring.limit(max(count, 1)) for count in np.unique(checked).tolist()}
    found = [
        {
            "photo": key.photo,
            "point": key.point,
            "v": standing.residual.tolist(),
            "redundancy": redundancy,
            "w": w,
            "limit": limits[count],
        }
        for key, standing, redundancy, w, count in zip(
            keys, standings, redundancies(standings), np.sqrt(squares).tolist(), checked.tolist(), strict=True
        )
    ]
    return sorted(found, key=lambda one: -one["w"] / one["limit"])


def statistics_of(measuring: Measuring) -> Shown:
    """Return the square sum of the standard residuals, redundancy, sigma0, and what they are made of."""
    block = measuring.block
    kinds: dict[str, int] = {}
    for key, rows in block.equations.included.items():
        kinds[key.kind] = kinds.get(key.kind, 0) + len(rows.right)
    equations = sum(kinds.values())
    return {
        "equations": equations,
        "unknowns": equations - block.equations.redundancy,
        "redundancy": block.equations.redundancy,
        "square sum": block.equations.square_sum,
        "sigma0": block.sigma0,
        "by kind": kinds,
        "suspects": len(measuring.suspects),
        "excluded": len(measuring.excluded),
    }
