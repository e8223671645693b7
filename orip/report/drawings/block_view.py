"""The block in three dimensions: photos as pyramids over their frames, points by kind, rays; what is up."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from orip.arrays import FloatArray
from orip.bundle.groups.words import group_name
from orip.geometry.rotation import rotation_from_angles
from orip.interior.mounting import frame_corners
from orip.records.camera import Camera
from orip.records.coded_names import coded
from orip.records.names import record_key
from orip.records.photo import PHOTO_PARAMETERS
from orip.records.results.solution import Solution
from orip.records.results.tests import GroupTest
from orip.records.rig import OFFSET
from orip.report.drawings.ellipses import drawn_points
from orip.report.drawings.residual_vectors import measured_reach
from orip.report.report_input import ReportInput
from orip.units import DEGREES_PER_RADIAN

# Up is Z, or in a network without given coordinates what the photos tell.

_FEWEST = 3
_FLAT = 0.15
"""Projection centres that reach less far across than this part of their length are on a line, and have no plane."""


_FRONT = 0.5
"""Photos whose axes are this far from the vertical (cosine), and this much in one direction, make a front view."""


class Vertical(NamedTuple):
    """The axes of drawings: rows (3, 3) are right, up on paper, and vertical, unit vectors of the ground system.

    `note` says where the vertical comes from; it is empty where it is Z.
    """

    axes: FloatArray
    note: str = ""


def vertical(given: ReportInput) -> Vertical:
    """Return the vertical: Z if coordinates were given to anything, else the normal of a mean plane.

    The plane is that of the projection centres or, where these lie on a line, that of the points. Up is where the
    photos are seen from the points.
    """
    solution = given.solution
    has_given = coded(solution.point_kinds).where("tie".__ne__).any() or bool(solution.exposures)
    if given.bundle.datum != "free" or has_given or given.bundle.datum_points:
        return Vertical(np.eye(3))
    centres, points = _known(solution.photos.values[:, :3]), _known(solution.points.values)
    normals = {"projection centres": _normal(centres), "points": _normal(points)}
    found = [(what, normal) for what, normal in normals.items() if normal is not None]
    if not found:
        return Vertical(np.eye(3))
    what, normal = found[0]
    side = float((centres.mean(axis=0) - points.mean(axis=0)) @ normal) if len(centres) and len(points) else normal[2]
    where = f"the normal of the mean plane of the {what}"
    note = f"No coordinates were given, so Z is not vertical: up is {where}."
    return Vertical(_axes(normal if side >= 0.0 else -normal), note)


class BlockSide(NamedTuple):
    """The plane that the block is drawn in.

    `axes` (3, 3) are right and up on paper, and towards the reader; `names` those of the first two, `third` what
    lengths along the third one are.
    """

    title: str
    axes: FloatArray
    names: tuple[str, str]
    third: str


def side_of_block(up: Vertical, looking: FloatArray) -> BlockSide:
    """Return the plan or, where the photos look sideways in about one direction, a view from the front.

    Parameters
    ----------
    looking : array (n, 3)
        The directions in which the photos look.
    """
    known = _known(looking)
    mean = known.mean(axis=0) if len(known) else -up.axes[2]
    level = mean - (mean @ up.axes[2]) * up.axes[2]
    if np.linalg.norm(level) > _FRONT and abs(mean @ up.axes[2]) < _FRONT:
        towards = -level / np.linalg.norm(level)
        axes = np.stack([np.cross(up.axes[2], towards), up.axes[2], towards])
        return BlockSide(
            "View of the block from the front", axes, (_name(axes[0], "across"), _name(axes[1], "up")), "depth"
        )
    return BlockSide("Plan of the block", up.axes, (_name(up.axes[0], "across"), _name(up.axes[1], "along")), "height")


def _name(axis: FloatArray, otherwise: str) -> str:
    """Return the name of a coordinate axis, or other words for a direction between them."""
    place = int(np.argmax(np.abs(axis)))
    return "XYZ"[place] if axis[place] > 1.0 - 1e-9 else otherwise


def _known(places: FloatArray) -> FloatArray:
    return np.asarray(places[np.isfinite(places).all(axis=1)])


def _normal(places: FloatArray) -> FloatArray | None:
    """Return the normal of the mean plane of places; None where they are too few, or on a line."""
    if len(places) < _FEWEST:
        return None
    _, sizes, directions = np.linalg.svd(places - places.mean(axis=0), full_matrices=False)
    return np.asarray(directions[2]) if sizes[1] > _FLAT * sizes[0] else None


def _axes(normal: FloatArray) -> FloatArray:
    """Return right, up on paper and the normal; right is as near to X, or where that is the normal to Y, as can be."""
    along = np.eye(3)[0 if abs(normal[0]) < 0.9 else 1]
    right = along - (along @ normal) * normal
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(normal, right), normal])


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
    motions = {one.photo: one.pixels for one in solution.motions}
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
            "kinds": list(coded(solution.point_kinds)[rows]),
            "xyz": _rounded(points - origin),
            "of": len(solution.points.names),
        },
        "photos": {
            "names": list(solution.photos.names),
            "xyz": _rounded(centres - origin),
            "corners": [_rounded(corner) for corner in corners],
            "sees": [place[seen[shown[seen]]].tolist() for seen in given.seen_points],
            "motions": [
                f"<br>motion {motions[name]:.1f} px" if name in motions else "" for name in solution.photos.names
            ],
        },
        "bodies": [{"name": name, "xyz": _rounded(places - origin)} for name, places in rig_bodies(solution).items()],
    }


def rig_bodies(solution: Solution) -> dict[str, FloatArray]:
    """Return by the names of exposures the places (1 + cameras, 3) of the rig and of all its cameras, on the ground."""
    offsets: dict[str, dict[str, dict[str, float]]] = {}
    for one in solution.mountings:
        offsets.setdefault(one.rig, {}).setdefault(one.camera, {})[one.name] = one.value
    elements: dict[tuple[str, str], dict[str, float]] = {}
    for row in solution.rig_exposures:
        elements.setdefault((row.exposure, row.rig), {})[row.name] = row.value
    found = {}
    for (exposure, rig), values in elements.items():
        place, angles = np.split(np.array([values[name] for name in PHOTO_PARAMETERS]), 2)
        rotation = rotation_from_angles(angles / DEGREES_PER_RADIAN)
        arms = np.array([[camera[name] for name in OFFSET] for camera in offsets[rig].values()])
        found[f"{exposure} of rig {rig}"] = np.vstack([place, place + arms @ rotation.T])
    return found


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


def doubted_photos(given: ReportInput) -> Mapping[str, tuple[str, ...]]:
    """Return the names of the doubted groups by photo, for groups that have some of the photos and not all."""
    found: dict[str, list[str]] = {}
    for group in given.solution.groups:
        photos = _photos_of(given, group) if group.doubted else ()
        if len(photos) < len(given.solution.photos.names):
            for name in photos:
                found.setdefault(name, []).append(group_name(group))
    return {name: tuple(dict.fromkeys(groups)) for name, groups in found.items()}


def _photos_of(given: ReportInput, group: GroupTest) -> tuple[str, ...]:
    if group.kind in {"station", "attitude"}:
        strips = ((exposure.photo, exposure.strip) for exposure in given.solution.exposures)
        return tuple(photo for photo, strip in strips if group.of in {"", strip})
    if group.kind != "photo":
        return ()
    camera = record_key(group.of)
    return tuple(
        name
        for name in given.solution.photos.names
        if (photo := given.photos.get(record_key(name))) is not None and record_key(photo.camera) == camera
    )
