"""The block in three dimensions: photos as pyramids over their frames, points by kind, rays."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from orip.arrays import FloatArray
from orip.geometry.rotation import rotation_from_angles
from orip.interior.fiducial_system import frame_corners
from orip.records.names import record_key
from orip.records.project.camera import Camera
from orip.report.drawings.ellipses import drawn_points
from orip.report.drawings.residual_vectors import measured_reach
from orip.report.report_input import ReportInput
from orip.report.vertical import Vertical, vertical
from orip.units import DEGREES_PER_RADIAN

MOST_POINTS = 10_000
_DEPTH = 0.25
"""Height of a photo's pyramid, as a part of its median distance from its points."""

_FAR_AWAY = 20.0
"""Multiple of the block's size from which coordinates are reduced: browsers draw in single precision."""


def block_view(given: ReportInput) -> dict[str, Any]:
    """Return what the page's script draws; coordinates are reduced by `origin`, so that single precision is enough."""
    solution, up = given.solution, vertical(given)
    rows = drawn_points(solution, MOST_POINTS)
    points, centres = solution.points.values[rows], solution.photos.values[:, :3]
    origin = _origin(np.concatenate([points, centres]))
    corners = pyramid_corners(given) - origin
    shown = np.zeros(len(solution.points.names), dtype=bool)
    shown[rows] = True
    place = np.cumsum(shown) - 1
    return {
        "origin": origin.tolist(),
        "unit": solution.ground_unit,
        "camera": _camera(up),
        "upwards": up.note,
        "points": {
            "names": [solution.points.names[row] for row in rows],
            "kinds": [solution.point_kinds[row] for row in rows],
            "xyz": _rounded(points - origin),
            "of": len(solution.points.names),
        },
        "photos": {
            "names": list(solution.photos.names),
            "xyz": _rounded(centres - origin),
            "corners": [_rounded(corner) for corner in corners],
            "sees": [place[seen[shown[seen]]].tolist() for seen in given.seen_points],
        },
    }


def pyramid_corners(given: ReportInput) -> FloatArray:
    """Return the corners (photos, 4, 3) of the photos' frames, in the direction they look, in ground coordinates.

    From the lower left counter-clockwise as in the positive photo. The true rays leave the projection centre there:
    a corner (x, y) of the frame is R (x - DX, y - DY, -C), enlarged.
    """
    solution = given.solution
    known = given.depths[np.isfinite(given.depths)]
    usual = float(np.median(known)) if known.size else 1.0 / _DEPTH
    depth = _DEPTH * np.nan_to_num(given.depths, nan=usual)
    return np.asarray(solution.photos.values[:, None, :3] + frame_rays(given, depth))


def frame_rays(given: ReportInput, depth: FloatArray | None = None) -> FloatArray:
    """Return the rays (photos, 4, 3) to the corners of the frames, ground directions, mm: see `pyramid_corners`.

    With `depth` (photos,) they are enlarged to this distance along the camera axis.
    """
    solution = given.solution
    values = solution.photos.values
    rotations = rotation_from_angles(values[:, 3:] / DEGREES_PER_RADIAN)
    parameters = dict(zip(map(record_key, solution.cameras.names), solution.cameras.values, strict=True))
    frames = {key: _frame(given, key) for key in parameters}
    directions = np.zeros((len(values), 4, 3))
    for row, name in enumerate(solution.photos.names):
        photo = given.photos.get(record_key(name))
        key = record_key(photo.camera) if photo is not None else ""
        # a photo may be gone, or have got another camera, since the block was adjusted
        key = key if key in parameters else next(iter(parameters))
        c, dx, dy = parameters[key][:3]
        directions[row] = [(x - dx, y - dy, -c) for x, y in frames[key]]
        directions[row] *= depth[row] / c if depth is not None else 1.0
    return np.asarray(directions @ rotations.transpose(0, 2, 1))


def _frame(given: ReportInput, camera: str) -> list[tuple[float, float]]:
    record: Camera | None = given.cameras.get(camera)
    corners = frame_corners(record) if record is not None else None
    if corners is None:
        reach = measured_reach(given, camera) / np.sqrt(2.0) or 1.0
        corners = np.array([-reach, -reach]), np.array([reach, reach])
    (left, lower), (right, upper) = corners
    return [(left, lower), (right, lower), (right, upper), (left, upper)]


def _camera(up: Vertical) -> dict[str, dict[str, float]]:
    """Return from where the block is seen, in units of its size: obliquely from above, the vertical upwards."""
    axes = dict(zip(("eye", "up"), (np.array([1.0, -1.75, 0.9]) @ up.axes, up.axes[2]), strict=True))
    places = {name: dict(zip("xyz", np.round(place, 6).tolist(), strict=True)) for name, place in axes.items()}
    return {**places, "center": dict(zip("xyz", np.round(-0.1 * up.axes[2], 6).tolist(), strict=True))}


def _origin(places: FloatArray) -> FloatArray:
    """Return round coordinates below all others, so that what is drawn has no sign."""
    known = places[np.isfinite(places).all(axis=1)]
    if not len(known):
        return np.zeros(3)
    spread = max(float(np.ptp(known, axis=0).max()), 1e-6)
    if np.abs(known).max() < _FAR_AWAY * spread:
        return np.zeros(3)
    step = 10.0 ** np.ceil(np.log10(spread))
    return np.asarray(np.floor(known.min(axis=0) / step) * step)


def _rounded(places: FloatArray) -> list[list[float | None]]:
    """Return coordinates with as many decimals as a drawing can show; None for what is not a number."""
    spread = float(np.abs(places[np.isfinite(places)]).max(initial=1e-6))
    decimals = int(np.clip(6 - np.ceil(np.log10(spread)), 0, 9))
    rounded: list[list[float | None]] = np.round(places, decimals).tolist()
    if np.isfinite(places).all():
        return rounded
    return [[value if value is not None and math.isfinite(value) else None for value in place] for place in rounded]
