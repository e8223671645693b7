"""Blocks with known truth, the same on every run: the name of a case is the seed of its random numbers.

The images are computed here from the formulas of docs/conventions.md, with scipy's rotations and without orip's
geometry, so that a sign that is wrong in orip shows.
"""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from typing import Literal

import numpy as np
from msgspec import Struct
from scipy.spatial.transform import Rotation

from orip.records.block import Block, IndexedPhotoPoints
from orip.records.camera import Camera, Projection
from orip.records.control import ControlPoint
from orip.records.definition import BundleDefinition, Precision
from orip.records.photo import PHOTO_PARAMETERS, Photo

Scene = Literal["strip", "convergent", "terrestrial", "room"]

NO_DISTORTION = (0.0,) * 9
DISTORTED = (2e-4, -3e-3, 2e-3, -1e-3, 5e-4, 2e-4, -3e-4, 1e-4, -2e-4)
"""A1 A3 A5 A7 A9 P1 P2 B1 B2, with half the frame as unit of length: images move by some thousandths of the frame."""

_POWERS = np.array([0, 2, 4, 6, 8, 1, 1, 0, 0])
"""Of a length that the coefficients A1 to B2 are divided by."""


class SyntheticBlock(Struct, frozen=True):
    """A block as a user would have it, and what it was made from.

    Attributes
    ----------
    block : Block
        Measurements with noise, starting values off the truth.
    cameras : array (number of cameras, 13)
    orientations : array (number of photos, 6)
        Ground unit and radians.
    points : array (number of points, 3)
    """

    block: Block
    cameras: np.ndarray
    orientations: np.ndarray
    points: np.ndarray


class _Layout(Struct, frozen=True):
    """Truth of a scene: principal distance and frame (mm), orientations (ground unit, degrees), points."""

    principal_distance: float
    frame: float
    orientations: np.ndarray
    points: np.ndarray
    projection: Projection = "perspective"


def synthetic_block(
    scene: Scene,
    name: str,
    *,
    noise_mm: float = 0.0,
    precision_mm: float = 0.005,
    control: Literal["weighted", "constant", "none"] = "weighted",
    control_error: float = 0.01,
    distortion: Sequence[float] = NO_DISTORTION,
    distortion_at: Literal["ideal", "measured"] = "ideal",
    unknown: Sequence[str] = (),
    constant: Sequence[Sequence[str]] = (),
    start_error: float = 0.0,
    **definition: object,
) -> SyntheticBlock:
    """Make a block.

    Parameters
    ----------
    scene : {"strip", "convergent", "terrestrial", "room"}
        Vertical photos of a strip of 2.5 km; eight photos around a metre-sized object; photos of two opposite walls
        from between them, taken exactly along X at phi = ±90 degrees; eight fisheye photos all around a room.
    name : str
        Seed of everything that is random.
    noise_mm : float
        Standard deviation of the errors of photo coordinates.
    precision_mm : float
        A-priori error of photo coordinates.
    control : {"weighted", "constant", "none"}
        Every fourth point is a full control point. Weighted ones carry errors of `control_error` if there is noise.
    control_error : float
        A-priori error of weighted control, as a part of what 1 mm in the photo is on the ground.
    distortion : 9 floats
        A1 to B2 for coordinates in units of half the frame.
    distortion_at, unknown
        Of the camera.
    constant : sequence of names of orientation elements for each photo
        Those are started at the truth.
    start_error : float
        Starting values are off by this part of the distance to the object, and as many radians.
    definition
        Other settings of the bundle adjustment.
    """
    random = np.random.default_rng(zlib.crc32(f"{scene} {name}".encode()))
    layout = _LAYOUTS[scene](random)
    camera = np.array(
        [layout.principal_distance, 0.12, -0.07, *np.array(distortion) / (layout.frame / 2.0) ** _POWERS, 0.0]
    )
    orientations = layout.orientations.copy()
    orientations[:, 3:] = np.radians(orientations[:, 3:])
    photo, point, xy = _images(layout, orientations, camera, distortion_at)
    seen = np.unique(point)
    points = layout.points[seen]
    point = np.searchsorted(seen, point)
    xy = xy + noise_mm * random.normal(size=xy.shape)

    distance = float(np.mean(np.linalg.norm(points[point] - orientations[photo, :3], axis=1)))
    ground_per_mm = distance / layout.principal_distance
    start, point_start = orientations.copy(), points + start_error * distance * random.normal(size=points.shape)
    start += start_error * np.repeat([distance, 1.0], 3) * random.normal(size=start.shape)
    held = [*constant, *[()] * (len(orientations) - len(constant))]
    for row, names in enumerate(held):
        for element in names:
            start[row, PHOTO_PARAMETERS.index(element)] = orientations[row, PHOTO_PARAMETERS.index(element)]
    names = tuple(str(101 + number) for number in range(len(points)))
    known = np.arange(0, len(points), 4) if control != "none" else np.array([], dtype=int)
    error = control_error * ground_per_mm if control == "weighted" else 0.0
    coordinates = points[known] + (error * random.normal(size=(len(known), 3)) if noise_mm > 0.0 else 0.0)
    constant_points = np.zeros((len(points), 3), dtype=bool)
    if control == "constant":
        constant_points[known] = True
        point_start[known] = coordinates
    photo_names = [f"P{number + 1}" for number in range(len(orientations))]
    block = Block(
        definition=BundleDefinition(name, Precision(precision_mm), **definition),
        cameras=(
            Camera("CAM", tuple(camera.tolist()), distortion_at, unknown=tuple(unknown), projection=layout.projection),
        ),
        photos=tuple(
            Photo(
                label, "CAM", orientation=tuple(np.r_[row[:3], np.degrees(row[3:])].tolist()), constant=tuple(elements)
            )
            for label, row, elements in zip(photo_names, start, held, strict=True)
        ),
        photo_camera=np.zeros(len(orientations), dtype=np.int64),
        photo_orientation=start,
        point_names=names,
        point_start=point_start,
        photo_points=IndexedPhotoPoints(
            photo, point, xy, np.full(xy.shape, precision_mm), np.ones(xy.shape, dtype=bool)
        ),
        constant_points=constant_points,
        control_points=tuple(
            ControlPoint(names[index], tuple(xyz), (error,) * 3)
            for index, xyz in zip(known, coordinates.tolist(), strict=True)
        ),
    )
    return SyntheticBlock(block, camera[None], orientations, points)


def _strip(random: np.random.Generator) -> _Layout:
    count = 6
    orientations = np.zeros((count, 6))
    orientations[:, 0] = 1000.0 + 500.0 * np.arange(count)
    orientations[:, 1] = 2000.0
    orientations[:, 2] = 1200.0
    orientations += random.normal(size=orientations.shape) * [10.0, 10.0, 10.0, 1.0, 1.0, 3.0]
    x, y = np.meshgrid(np.linspace(700.0, 3800.0, 14), np.linspace(1550.0, 2450.0, 4))
    z = 200.0 + 40.0 * random.uniform(size=x.shape)
    return _Layout(153.0, 180.0, orientations, np.stack([x, y, z], axis=-1).reshape(-1, 3))


def _convergent(random: np.random.Generator) -> _Layout:
    middle = np.array([10.0, 20.0, 5.0])
    points = middle + random.uniform(-0.6, 0.6, (40, 3))
    orientations = []
    for number in range(8):
        around = np.radians(45.0 * number + random.normal() * 3.0)
        centre = middle + 4.0 * np.array([np.cos(around), np.sin(around), 0.6])
        back = centre - middle
        back /= np.linalg.norm(back)
        right = np.cross([0.0, 0.0, 1.0], back)
        right /= np.linalg.norm(right)
        axes = np.column_stack([right, np.cross(back, right), back])
        # every second photo is taken upright: without it the principal point hangs together with the centres
        rolled = axes @ Rotation.from_rotvec([0.0, 0.0, np.pi / 2.0 * (number % 2)]).as_matrix()
        orientations.append([*centre, *Rotation.from_matrix(rolled).as_euler("XYZ", degrees=True)])
    return _Layout(50.0, 36.0, np.array(orientations), points)


def _terrestrial(random: np.random.Generator) -> _Layout:
    # photos of both walls; with the photo's y axis up kappa is -90 where the camera looks to +X and +90 to -X
    orientations = [
        [sign * offset, north, 1.6 + 0.4 * random.normal(), 0.0, -90.0 * sign, -90.0 * sign]
        for sign in (1.0, -1.0)
        for offset, north in ((-2.0, -4.0), (0.0, 0.0), (-1.0, 4.0))
    ]
    north, up = np.meshgrid(np.linspace(-9.0, 9.0, 8), np.linspace(-2.0, 6.0, 4))
    walls = [
        np.stack([sign * (12.0 + 2.0 * random.uniform(size=north.shape)), north, up], axis=-1).reshape(-1, 3)
        for sign in (1.0, -1.0)
    ]
    return _Layout(60.0, 120.0, np.array(orientations), np.vstack(walls))


def _room(random: np.random.Generator) -> _Layout:
    half = np.array([5.0, 4.0, 1.75])
    points = random.uniform(-1.0, 1.0, (90, 3)) * half
    # onto the walls, the floor and the ceiling in turn
    side = np.arange(len(points)) % 3
    points[np.arange(len(points)), side] = np.sign(points[np.arange(len(points)), side]) * half[side]
    orientations = []
    for number in range(8):
        around, up = np.radians(45.0 * number), np.radians(25.0 * (-1.0) ** number)
        back = -np.array([np.cos(around) * np.cos(up), np.sin(around) * np.cos(up), np.sin(up)])
        right = np.cross([0.0, 0.0, 1.0], back)
        right /= np.linalg.norm(right)
        axes = np.column_stack([right, np.cross(back, right), back])
        rolled = axes @ Rotation.from_rotvec([0.0, 0.0, np.pi / 2.0 * (number % 2)]).as_matrix()
        centre = random.uniform(-1.0, 1.0, 3) * [2.0, 1.5, 0.5]
        orientations.append([*centre, *Rotation.from_matrix(rolled).as_euler("XYZ", degrees=True)])
    # the sides of the frame show 115 degrees from the axis
    return _Layout(9.0, 36.0, np.array(orientations), points, "equidistant")


_LAYOUTS = {"strip": _strip, "convergent": _convergent, "terrestrial": _terrestrial, "room": _room}


def _images(
    layout: _Layout, orientations: np.ndarray, camera: np.ndarray, distortion_at: str
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return photo, point and photo coordinates of all points that a photo shows."""
    photo, point, images = [], [], []
    for row, orientation in enumerate(orientations):
        rotation = Rotation.from_euler("XYZ", orientation[3:]).as_matrix()
        u = (layout.points - orientation[:3]) @ rotation
        ideal = camera[0] * _DIRECTIONS[layout.projection](u)
        shown = np.flatnonzero((np.abs(ideal) < layout.frame / 2.0).all(axis=1))
        photo.append(np.full(len(shown), row))
        point.append(shown)
        images.append(camera[1:3] + _MEASURED[distortion_at](ideal[shown], camera[3:12]))
    return np.concatenate(photo), np.concatenate(point), np.vstack(images)


def _on_a_plane(u: np.ndarray) -> np.ndarray:
    return -u[:, :2] / np.where(u[:, 2:] < 0.0, u[:, 2:], np.nan)


def _by_angles(u: np.ndarray) -> np.ndarray:
    angle = np.arccos(-u[:, 2] / np.linalg.norm(u, axis=1))
    return angle[:, None] * u[:, :2] / np.linalg.norm(u[:, :2], axis=1, keepdims=True)


_DIRECTIONS = {"perspective": _on_a_plane, "equidistant": _by_angles}


def _distortion(x: np.ndarray, y: np.ndarray, a: Sequence[float]) -> np.ndarray:
    a1, a3, a5, a7, a9, p1, p2, b1, b2 = a
    r = np.hypot(x, y)
    radial = a1 + a3 * r**2 + a5 * r**4 + a7 * r**6 + a9 * r**8
    dx = x * radial + p1 * (r**2 + 2 * x**2) + 2 * p2 * x * y + b1 * x + b2 * y
    dy = y * radial + p2 * (r**2 + 2 * y**2) + 2 * p1 * x * y
    return np.stack([dx, dy], axis=-1)


def _measured_at_ideal(ideal: np.ndarray, a: np.ndarray) -> np.ndarray:
    return ideal + _distortion(*ideal.T, a)


def _measured_at_measured(ideal: np.ndarray, a: np.ndarray) -> np.ndarray:
    without_affinity = [*a[:7], 0.0, 0.0]
    measured = ideal
    # what is added changes by less than a hundredth of what it is added to: 20 rounds leave nothing
    for _ in range(20):
        affinity = np.stack([measured @ a[7:9], np.zeros(len(ideal))], axis=-1)
        measured = ideal + _distortion(*(measured - affinity).T, without_affinity) + affinity
    return measured


_MEASURED = {"ideal": _measured_at_ideal, "measured": _measured_at_measured}
