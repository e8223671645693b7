"""Blocks whose points lie on lines, planes, cylinders and at equal heights, but for errors of the a-priori size."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from msgspec import Struct
from scipy.spatial.transform import Rotation
from support.synthetic_block import SyntheticBlock

from orip.records.block import Block, IndexedPhotoPoints
from orip.records.camera import Camera
from orip.records.control import ControlPoint, FigureKind, FigurePoint
from orip.records.definition import BundleDefinition, Precision
from orip.records.photo import Photo

C_MM, PHOTO_ERROR_MM, CONTROL_ERROR, FIGURE_ERROR = 50.0, 0.003, 0.005, 0.002
FRAME_MM = np.array([36.0, 24.0])


class Figure(Struct, frozen=True):
    """A figure: its points, and for each the directions (n, k, 3) in which it may be off."""

    name: str
    kind: FigureKind
    points: np.ndarray
    across: np.ndarray


def line(name: str = "EDGE", count: int = 6) -> Figure:
    direction = np.array([0.8, 0.3, 0.52]) / np.linalg.norm([0.8, 0.3, 0.52])
    side = np.cross([0.0, 0.0, 1.0], direction)
    side /= np.linalg.norm(side)
    points = np.array([-4.0, -3.0, 1.0]) + np.linspace(-3.0, 3.0, count)[:, None] * direction
    return Figure(name, "LINE", points, np.tile(np.stack([side, np.cross(direction, side)]), (count, 1, 1)))


def plane(name: str = "ROOF", count: int = 9) -> Figure:
    normal = np.array([0.3, -0.2, 1.0]) / np.linalg.norm([0.3, -0.2, 1.0])
    first = np.cross([0.0, 1.0, 0.0], normal)
    first /= np.linalg.norm(first)
    a, b = np.random.default_rng(1).uniform(-3.0, 3.0, (2, count))
    points = np.array([4.0, 3.0, 2.0]) + a[:, None] * first + b[:, None] * np.cross(normal, first)
    return Figure(name, "PLANE", points, np.tile(normal, (count, 1, 1)))


def cylinder(name: str = "TANK", count: int = 12, radius: float = 1.5) -> Figure:
    """Return a lying cylinder, of which the photos see the upper side."""
    turn = np.linspace(-1.3, 1.3, count)
    along = np.random.default_rng(2).uniform(-3.0, 3.0, count)
    axis, up = np.array([0.6, 0.8, 0.0]), np.array([0.0, 0.0, 1.0])
    outward = np.cos(turn)[:, None] * up + np.sin(turn)[:, None] * np.cross(axis, up)
    points = np.array([4.0, -4.0, 0.0]) + along[:, None] * axis + radius * outward
    return Figure(name, "CYLINDER", points, outward[:, None])


def level(name: str = "LAKE", count: int = 6) -> Figure:
    x, y = np.random.default_rng(3).uniform(-3.0, 3.0, (2, count))
    points = np.stack([x - 4.0, y + 4.0, np.full(count, 0.7)], axis=1)
    return Figure(name, "HEIGHT", points, np.tile([0.0, 0.0, 1.0], (count, 1, 1)))


EVERY = (line(), plane(), cylinder(), level())


def figure_block(
    run: int, figures: tuple[Figure, ...] = EVERY, *, noise: bool = True, error: float = FIGURE_ERROR,
    wrong: Mapping[str, tuple[int, float]] | None = None,
    moved: Callable[[np.ndarray], np.ndarray] = lambda points: points, **settings: object,
) -> SyntheticBlock:  # fmt: skip
    """Return a block of eight convergent photos with normal errors of all observations, and the truth.

    Parameters
    ----------
    run : int
        Seed of the errors.
    figures : tuple of Figure
    noise : bool
    error : float
        Standard deviation of points from their figures, and its a-priori error.
    wrong : mapping
        By name of a figure the number of a distance of its points, and by how much more that is off.
    moved : callable
        Where the 24 points that are on no figure are, from what they are else.
    settings
        Of the bundle adjustment.
    """
    random = np.random.default_rng([9, run])
    random_tie = np.random.default_rng(4).uniform([-8.0, -6.0, -1.0], [8.0, 6.0, 3.0], (24, 3))
    tie = moved(random_tie)
    off = []
    for figure in figures:
        distances = error * random.normal(size=figure.across.shape[:2]) * noise
        number, size = (wrong or {}).get(figure.name, (0, 0.0))
        distances.ravel()[number] += size
        off.append(np.einsum("nk,nki->ni", distances, figure.across))
    points = np.vstack([tie, *(figure.points + apart for figure, apart in zip(figures, off, strict=True))])
    names = [f"N{number}" for number in range(len(tie))]
    names += [f"{figure.name[0]}{number}" for figure in figures for number in range(len(figure.points))]
    orientations = _orientations()
    xy, _ = _images(points, orientations)
    # so that blocks with other errors have the same photo points
    _, seen = _images(np.vstack([random_tie, *(figure.points for figure in figures)]), orientations)
    photo, point = np.nonzero(seen)
    measured = xy[photo, point] + PHOTO_ERROR_MM * random.normal(size=(len(photo), 2)) * noise
    given = tie + CONTROL_ERROR * random.normal(size=tie.shape) * noise
    block = Block(
        definition=BundleDefinition("figures", Precision(PHOTO_ERROR_MM), **settings),
        cameras=(Camera("CAM", (C_MM, *np.zeros(12).tolist()), frame=tuple(FRAME_MM.tolist())),),
        photos=tuple(
            Photo(f"P{row}", "CAM", orientation=tuple(np.r_[one[:3], np.degrees(one[3:])].tolist()))
            for row, one in enumerate(orientations)
        ),
        photo_camera=np.zeros(len(orientations), dtype=np.int64),
        photo_orientation=orientations.copy(),
        point_names=tuple(names),
        point_start=points.copy(),
        photo_points=IndexedPhotoPoints(
            photo, point, measured, np.full(measured.shape, PHOTO_ERROR_MM), np.ones(measured.shape, dtype=bool)
        ),
        constant_points=np.zeros((len(points), 3), dtype=bool),
        control_points=tuple(
            ControlPoint(names[row], tuple(given[row].tolist()), (CONTROL_ERROR,) * 3) for row in range(0, len(tie), 4)
        ),
        figure_points=tuple(
            FigurePoint(figure.name, figure.kind, f"{figure.name[0]}{number}", error)
            for figure in figures
            for number in range(len(figure.points))
        ),
    )
    cameras = np.array([[C_MM, *np.zeros(12)]])
    return SyntheticBlock(block, cameras, orientations, points)


def _orientations() -> np.ndarray:
    """Return photos in two rows, 25 above the points, that look towards their middle."""
    rows = []
    for x, y in [(x, y) for y in (-9.0, 9.0) for x in (-12.0, -4.0, 4.0, 12.0)]:
        centre = np.array([x, y, 25.0])
        back = centre / np.linalg.norm(centre)
        right = np.cross([0.0, 1.0, 0.0], back)
        right /= np.linalg.norm(right)
        rotation = np.stack([right, np.cross(back, right), back], axis=1)
        rows.append([*centre, *Rotation.from_matrix(rotation).as_euler("XYZ")])
    return np.array(rows)


def _images(points: np.ndarray, orientations: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    rotation = Rotation.from_euler("XYZ", orientations[:, 3:]).as_matrix()
    u = np.einsum("pkj,pik->pij", rotation, points[None] - orientations[:, None, :3])
    xy = -C_MM * u[:, :, :2] / u[:, :, 2:]
    return xy, (np.abs(xy) < FRAME_MM / 2.0).all(axis=2)
