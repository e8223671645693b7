"""Which camera parameters the photos of an imported block can determine at all."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from orip.arrays import BoolArray, FloatArray, IntArray, rows_of_groups
from orip.exchange.conversion.cameras import ConvertedCamera, pixels_of_directions
from orip.exchange.conversion.reprojection import Reprojection, in_photo_axes, with_intersections
from orip.records.camera import CAMERA_PARAMETERS, Camera
from orip.records.exchanged import ExchangedCamera, ExchangedProject
from orip.structs import replace

# The test is generous: points count as known, so that a parameter that it finds undetermined is one whatever else the
# block has. Each photo gives the normal equations of its pose and of its camera; poses are eliminated. Beside that
# there have to be four photos, and more observations than unknowns.

_MOST_UNSURE = 0.5
"""Of the radius of what is measured: what errors of 1 px in the measurements may do to the image there."""

_HELD_FIRST = ("A9", "A7", "B2", "B1", "A5", "P2", "P1", "DY", "DX", "A3", "C")
"""The order in which parameters are given up."""

_DATUM = 7
"""Origin, axes and scale, which a block without control and positions takes as they are."""

_FEWEST_PHOTOS = 4
"""In a block; with three, distortion hides in poses and points, most of which have two rays."""

_STEP_PX = 1e-3
"""By which a parameter moves the image for its partials."""

_SINGULAR = 1e-11
"""Of the largest eigenvalue of the scaled normal equations."""

_NOTHING = 1e-200
"""In place of an eigenvalue of 0."""


def determined_parameters(
    project: ExchangedProject, cameras: Sequence[ConvertedCamera], pixels: FloatArray, found: Reprojection
) -> tuple[tuple[str, ...], ...]:
    """Return, for each camera, those of its unknown parameters that its photos can determine.

    Parameters
    ----------
    project : ExchangedProject
        With stations in the system of the photos.
    pixels : array (k, 2)
        Of the rays, as orip counts them.
    found : Reprojection
        The poses of the photos.
    """
    rays = project.rays
    if len(np.unique(rays.photo[rays.is_active])) < _FEWEST_PHOTOS:
        return tuple(() for _ in cameras)
    camera_of_ray = np.array([photo.camera for photo in project.photos], dtype=np.int64)[rays.photo]
    sharing = np.bincount(rays.point[rays.is_active], minlength=len(project.points.names))
    controls = {point.name for point in project.control}
    is_control = np.array([name in controls for name in project.points.names], dtype=np.bool_)
    used = rays.is_active & ((sharing >= 2) | is_control)[rays.point]
    offset = _offsets(project, cameras, camera_of_ray, pixels, found, used)
    used &= np.isfinite(offset).all(axis=1) & (offset[:, 2] < 0.0)
    weights = _station_weights(project, found)
    unknown = _countable([one.camera.unknown for one in cameras], _redundancy(project, used, is_control))
    result = []
    for number, (converted, rows) in enumerate(
        zip(cameras, rows_of_groups(np.where(used, camera_of_ray, -1), len(cameras)), strict=True)
    ):
        names = unknown[number]
        if not names:
            result.append(names)
            continue
        result.append(_determined(converted.camera, names, offset[rows], rays.photo[rows], weights))
    return tuple(result)


def _redundancy(project: ExchangedProject, used: BoolArray, is_control: BoolArray) -> int:
    """Return how many more observations than unknowns the block has if its cameras are held."""
    has_photo = np.bincount(project.rays.photo[used], minlength=len(project.photos)) > 0
    has_point = np.bincount(project.rays.point[used], minlength=len(is_control)) > 0
    given = 3 * int((is_control & has_point).sum()) + sum(3 for one in project.stations if one.has_position)
    return 2 * int(used.sum()) + max(given, _DATUM) - 6 * int(has_photo.sum()) - 3 * int(has_point.sum())


def _countable(unknown: Sequence[tuple[str, ...]], redundancy: int) -> list[tuple[str, ...]]:
    """Return fewer parameters of all cameras where the observations are not more than the unknowns."""
    left = list(unknown)
    for name in _HELD_FIRST:
        if sum(map(len, left)) < redundancy:
            break
        left = [tuple(other for other in names if other != name) for names in left]
    return left


def _offsets(
    project: ExchangedProject,
    cameras: Sequence[ConvertedCamera],
    camera_of_ray: IntArray,
    pixels: FloatArray,
    found: Reprojection,
    used: BoolArray,
) -> FloatArray:
    """Return the points of rays in the axes of their photos, array (k, 3); NaN where they are not known."""
    photo, point = project.rays.photo, project.rays.point
    centres, coordinates = found.centres[photo], project.points.coordinates
    if not np.isfinite(coordinates[point[used]]).all():
        rotations = found.rotations[photo]
        coordinates = with_intersections(cameras, camera_of_ray, pixels, coordinates, rotations, centres, point, used)
    with np.errstate(all="ignore"):
        return np.stack(in_photo_axes(found.rotations, photo, coordinates[point] - centres), axis=1)


def _station_weights(project: ExchangedProject, found: Reprojection) -> FloatArray:
    """Return what observed positions add to the normal equations of projection centres along their photos' axes."""
    place = {photo.name: row for row, photo in enumerate(project.photos)}
    weights = np.zeros((len(project.photos), 3, 3))
    for station in project.stations:
        row = place.get(station.photo)
        if row is None or not station.has_position or min(station.position_error) <= 0.0:
            continue
        rotation = found.rotations[row]
        weights[row] = rotation.T @ np.diag(1.0 / np.square(station.position_error)) @ rotation
    return np.where(np.isfinite(weights), weights, 0.0)


def _determined(
    camera: Camera, names: tuple[str, ...], offset: FloatArray, photo: IntArray, weights: FloatArray
) -> tuple[str, ...]:
    """Return those of the names that are determined, dropping one after the other until all that are left are."""
    tangents = offset[:, :2] / -offset[:, 2:]
    base = pixels_of_directions(camera, tangents)
    reach = base - pixels_of_directions(camera, np.zeros((1, 2)))
    radius = float(np.nanmax(np.hypot(*reach.T), initial=1.0))
    by_parameters = _by_parameters(camera, names, tangents, base, radius)
    by_pose = _by_pose(camera, tangents, base, -offset[:, 2])
    sound = np.isfinite(by_parameters).all(axis=(1, 2)) & np.isfinite(by_pose).all(axis=(1, 2))
    effect = np.linalg.norm(by_parameters[sound], axis=1).max(axis=0, initial=0.0)
    by_parameters = by_parameters[sound] / np.where(effect > 0.0, effect, 1.0)
    normal = _reduced(by_parameters, by_pose[sound], photo[sound], weights)
    left = list(range(len(names)))
    while left:
        unsure = _deviations(normal[np.ix_(left, left)]) > _MOST_UNSURE * radius
        if not unsure.any():
            break
        given_up = min((names[left[n]] for n in np.flatnonzero(unsure)), key=_HELD_FIRST.index)
        left.remove(names.index(given_up))
    return tuple(names[n] for n in left)


def _by_parameters(
    camera: Camera, names: tuple[str, ...], tangents: FloatArray, base: FloatArray, reach: float
) -> FloatArray:
    """Return the partials (n, 2, u) of pixels `base` by parameters, in units that move what is `reach` out by some."""
    found = np.empty((len(tangents), 2, len(names)))
    pixel = 1.0 if camera.sensor is None else camera.sensor.width / camera.sensor.columns
    radius = reach * pixel
    for column, name in enumerate(names):
        power = int(name[1]) if name[0] == "A" else 2 if name[0] == "P" else 1 if name[0] == "B" else 0
        unit = pixel / radius**power
        place = CAMERA_PARAMETERS.index(name)
        values = list(camera.parameters)
        values[place] += _STEP_PX * unit
        moved = replace(camera, parameters=tuple(values))
        found[:, :, column] = (pixels_of_directions(moved, tangents) - base) / _STEP_PX
    return found


def _by_pose(camera: Camera, tangents: FloatArray, base: FloatArray, depth: FloatArray) -> FloatArray:
    """Return the partials (n, 2, 6) of pixels `base` by a rotation about the photo's axes, its centre along them."""
    step = 1e-6
    by_x, by_y = ((pixels_of_directions(camera, tangents + step * axis) - base) / step for axis in np.eye(2))
    x, y = tangents.T
    nothing = np.zeros_like(x)
    x_by = (x * y, -1.0 - x * x, -y, -1.0 / depth, nothing, -x / depth)
    y_by = (1.0 + y * y, -x * y, x, nothing, -1.0 / depth, -y / depth)
    found = np.empty((len(x), 2, 6))
    for column, (of_x, of_y) in enumerate(zip(x_by, y_by, strict=True)):
        found[:, :, column] = by_x * of_x[:, None] + by_y * of_y[:, None]
    return found


def _reduced(by_parameters: FloatArray, by_pose: FloatArray, photo: IntArray, weights: FloatArray) -> FloatArray:
    """Return the normal equations (u, u) of the parameters, the poses of all photos being eliminated."""
    u = by_parameters.shape[2]
    normal = np.zeros((u, u))
    order = np.argsort(photo, kind="stable")
    for rows in np.split(order, np.flatnonzero(np.diff(photo[order])) + 1):
        if not rows.size:
            continue
        a, b = by_parameters[rows].reshape(-1, u), by_pose[rows].reshape(-1, 6)
        pose = b.T @ b
        pose[3:, 3:] += weights[photo[rows[0]]]
        scale = np.sqrt(np.where(np.diag(pose) > 0.0, np.diag(pose), 1.0))
        mixed = (a.T @ b) / scale
        normal += a.T @ a - mixed @ np.linalg.pinv(pose / np.outer(scale, scale), rcond=_SINGULAR) @ mixed.T
    return normal


def _deviations(normal: FloatArray) -> FloatArray:
    """Return the standard deviations (u,) that normal equations give; very large where they do not determine them."""
    values, vectors = np.linalg.eigh(normal)
    least = max(_SINGULAR * float(values.max(initial=0.0)), _NOTHING)
    return np.asarray(np.sqrt(vectors**2 @ (1.0 / np.maximum(values, least))))


_RADIAL = ("A3", "A5", "A7")
_HIGH_RADIAL = ("k4", "k5", "k6", "c4", "c5")
"""Radial terms beyond those of most lenses; with any of them A9 is estimated, too."""

_CROSSED = ("opencv", "equidistant", "fisheye624")
"""Lenses with OpenCV's order of p1 and p2."""

_SAME = {
    "f": ("C",), "fx": ("C",), "fy": ("C",), "cx": ("DX",), "cy": ("DY",),
    "k1": ("A3",), "c1": ("A3",), "a1": ("A3",),
    "k2": ("A5",), "c2": ("A5",), "a2": ("A5",),
    "k3": ("A7",), "c3": ("A7",), "a3": ("A7",),
    "k4": ("A9",), "c4": ("A9",),
    "q2": ("A3",), "q4": ("A5",), "q6": ("A7",),
    "omega": _RADIAL, "alpha": _RADIAL, "beta": (),
    "p1": ("P1",), "p2": ("P2",), "b1": ("B1",), "b2": ("B2",),
}  # fmt: skip


def unknown_parameters(camera: ExchangedCamera, *, is_exact: bool) -> tuple[str, ...]:
    """Return the parameters that the adjustment should estimate, as the other program has.

    Where orip's polynomial is fitted, all of its radial terms stand for any radial one of the other program.
    """
    found: set[str] = set()
    for name in camera.free:
        if not is_exact and name[0] in "kcaq" and name[1:].isdigit():
            found.update((*_RADIAL, "A9") if name in _HIGH_RADIAL else _RADIAL)
        elif camera.lens in _CROSSED and name in {"p1", "p2"}:
            found.add("P2" if name == "p1" else "P1")
        else:
            found.update(_SAME.get(name, ()))
    if {"fx", "fy"} <= set(camera.free) and camera.parameters.get("fx") != camera.parameters.get("fy"):
        found.add("B1")
    return tuple(name for name in CAMERA_PARAMETERS if name in found)
