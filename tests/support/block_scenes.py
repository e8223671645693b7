"""Scenes for the study of preliminary values: where cameras stand and look, and the surface that they look at.

Everything is made from the formulas of docs/conventions.md with scipy's rotations, without orip's geometry.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from msgspec import Struct
from scipy.spatial.transform import Rotation

from orip.structs import replace

UP = np.array([0.0, 0.0, 1.0])
_STEEPEST = np.cos(np.radians(75.0))
"""A surface seen more obliquely than that is not measured."""


class Scene(Struct, frozen=True):
    """Truth of a block before anything is measured.

    Attributes
    ----------
    principal_distance : float
        mm.
    frame : array (2,)
        Size of the photo in x and y, mm.
    centres : array (n, 3)
    rotations : array (n, 3, 3)
        Photo to ground.
    surface, normals : arrays (m, 3)
        Places that could be measured, and what is outside of the surface there.
    pairs : tuple of (left, right, row, column)
        Models of photos taken in strips; empty if there is no such order.
    """

    principal_distance: float
    frame: np.ndarray
    centres: np.ndarray
    rotations: np.ndarray
    surface: np.ndarray
    normals: np.ndarray
    pairs: tuple[tuple[int, int, int, int], ...] = ()

    def ideal(self, photo: int) -> tuple[np.ndarray, np.ndarray]:
        """Return ideal photo coordinates (m, 2) of the surface in a photo, and which places it shows."""
        offset = self.surface - self.centres[photo]
        u = offset @ self.rotations[photo]
        in_front = u[:, 2] < 0.0
        xy = -self.principal_distance * u[:, :2] / np.where(in_front, u[:, 2], -1.0)[:, None]
        towards = -np.einsum("ij,ij->i", offset, self.normals) / np.linalg.norm(offset, axis=1)
        return xy, in_front & (np.abs(xy) < 0.48 * self.frame).all(axis=1) & (towards > _STEEPEST)


def aerial_strips(random: np.random.Generator, photos: int) -> Scene:
    """Return vertical photos in one to eight strips, flown there and back over flat to mountainous ground."""
    # length of the photo along the flight and across it
    c, frame = ((153.0, (230.0, 230.0)), (100.0, (68.0, 104.0)))[random.integers(2)]
    per_mm = np.exp(random.uniform(np.log(3.0), np.log(30.0)))
    height = c * per_mm
    strips = int(random.integers(1, min(8, photos // 4) + 1)) if photos >= 8 else 1
    base = (1.0 - random.uniform(0.55, 0.80)) * frame[0] * per_mm
    spacing = (1.0 - random.uniform(0.20, 0.40)) * frame[1] * per_mm
    row, column = rows_and_columns(photos, strips)
    flown = np.column_stack([base * column, spacing * row, np.full(photos, height)])
    flown += random.normal(size=(photos, 3)) * [0.03 * base, 0.02 * spacing, 0.01 * height]
    azimuth = random.uniform(-180.0, 180.0)
    crab = random.uniform(-5.0, 5.0, strips)[row] + random.normal(size=photos)
    tilt = random.uniform(0.2, 1.0) * random.uniform(-5.0, 5.0, (photos, 2))
    kappa = azimuth + crab + 180.0 * (row % 2)
    along = (-0.5 * frame[0] * per_mm, base * column.max() + 0.5 * frame[0] * per_mm)
    across = (-0.5 * frame[1] * per_mm, spacing * row.max() + 0.5 * frame[1] * per_mm)
    hills = relief(random, height * np.exp(random.uniform(np.log(0.002), np.log(0.12))), height)
    surface, normals = height_field(random, along, across, hills, _places(photos, strips))
    turn = Rotation.from_euler("Z", azimuth, degrees=True).as_matrix()
    origin = np.array([*random.uniform(1e5, 9e5, 2), 400.0]) if random.random() < 0.5 else np.zeros(3)
    return Scene(
        c,
        np.array(frame),
        origin + flown @ turn.T,
        Rotation.from_euler("XYZ", np.column_stack([tilt, kappa]), degrees=True).as_matrix(),
        origin + surface @ turn.T,
        normals @ turn.T,
        _pairs(row, column),
    )


def convergent(random: np.random.Generator, photos: int) -> Scene:
    """Return photos from one to three rings around an object of 0.3 to 20 m, turned any way about their axes."""
    c, frame = _close_range_camera(random)
    size = np.exp(random.uniform(np.log(0.3), np.log(20.0)))
    rings = int(random.integers(1, 4)) if photos >= 12 else 1
    ring, place = rows_and_columns(photos, rings)
    step = min(random.uniform(15.0, 40.0), 360.0 / max(place.max() + 1, 1))
    around = np.radians(random.uniform(0.0, 360.0) + step * place + 0.1 * step * random.normal(size=photos))
    lowest = random.uniform(-5.0, 40.0)
    elevation = np.radians(lowest + random.uniform(20.0, 28.0) * ring + 3.0 * random.normal(size=photos))
    direction = _direction(around, elevation)
    filled = random.uniform(0.7, 1.1)
    distance = size * c / (filled * frame.min()) * (1.0 + 0.08 * random.normal(size=photos)) + 0.4 * size
    aimed = 0.06 * size * random.normal(size=(photos, 3))
    quarter = random.choice([0.0, 90.0, 180.0, -90.0], photos) * (random.random() < 0.7)
    roll = quarter + 8.0 * random.normal(size=photos)
    if random.random() < 0.5:
        surface, normals = _ellipsoid(random, 0.5 * size, 150 * photos + 1500)
    else:
        reach = (-0.5 * size, 0.5 * size)
        hills = relief(random, size * np.exp(random.uniform(np.log(0.01), np.log(0.25))), size)
        surface, normals = height_field(random, reach, reach, hills, 40 * photos + 600)
        # a plate is seen from one side: photos of the rings come from there
        direction = _direction(around, np.radians(np.clip(np.degrees(elevation), 25.0, 85.0)))
    scene = Scene(
        c, frame, distance[:, None] * direction, looking(aimed - distance[:, None] * direction, roll), surface, normals
    )
    return placed(scene, random, 10.0 * size)


def oblique_strips(random: np.random.Generator, photos: int) -> Scene:
    """Return hand-held photos of 24 x 36 mm of a slope or cliff, from a helicopter that passes one to four times."""
    c = float(random.choice([28.0, 35.0, 50.0, 85.0]))
    upright = random.random() < 0.3
    frame = np.array([24.0, 36.0] if upright else [36.0, 24.0])
    distance = np.exp(random.uniform(np.log(60.0), np.log(600.0)))
    per_mm = distance / c
    strips = int(random.integers(1, min(4, photos // 4) + 1)) if photos >= 8 else 1
    row, column = rows_and_columns(photos, strips)
    overlap = random.uniform(0.60, 0.75)
    bases = (1.0 - overlap) * frame[0] * per_mm * random.uniform(0.6, 1.2, column.max() + 1)
    along = np.cumsum(bases)[column] + 0.1 * bases.mean() * random.normal(size=photos)
    spacing = random.uniform(0.45, 0.65) * frame[1] * per_mm
    slope = np.radians(random.uniform(25.0, 80.0))
    # the slope's own axes: along it, up it, out of it
    axes = np.array([[1.0, 0.0, 0.0], [0.0, np.cos(slope), np.sin(slope)], [0.0, -np.sin(slope), np.cos(slope)]])
    tilt = np.radians(
        np.clip(np.degrees(slope) + random.uniform(-20.0, 15.0) + 4.0 * random.normal(size=photos), 20, 70)
    )
    sideways = np.radians(random.uniform(0.0, 12.0) * random.normal(size=photos).clip(-2.0, 2.0))
    towards = np.column_stack([np.sin(sideways), -np.cos(sideways) * np.sin(tilt), np.cos(sideways) * np.cos(tilt)])
    away = distance * (1.0 + random.uniform(0.05, 0.2) * (-1.0) ** (row + column) * random.uniform(0.5, 1.0, photos))
    aimed = np.column_stack([along, spacing * row, np.zeros(photos)]) @ axes
    hills = relief(random, distance * random.uniform(0.03, 0.12), distance)
    margin = 0.7 * frame * per_mm
    surface, normals = height_field(
        random,
        (along.min() - margin[0], along.max() + margin[0]),
        (-margin[1], spacing * row.max() + margin[1]),
        hills,
        _places(photos, strips),
    )
    roll = 5.0 * random.normal(size=photos)
    scene = Scene(
        c, frame, aimed + away[:, None] * towards, looking(-towards, roll), surface @ axes, normals @ axes,
        _pairs(row, column),
    )  # fmt: skip
    return placed(scene, random, 1e5)


def all_round(random: np.random.Generator, photos: int) -> Scene:
    """Return pairs of horizontal photos of plane walls: out of a courtyard at all of it, or all around a building."""
    scene = (_courtyard, _building)[random.integers(2)](random, photos)
    return placed(scene, random, 1000.0)


def _courtyard(random: np.random.Generator, photos: int) -> Scene:
    half = np.exp(random.uniform(np.log(2.0), np.log(25.0))) * np.array([1.0, random.uniform(0.6, 1.0)])
    high = half.min() * random.uniform(0.5, 1.2)
    frame = np.array([36.0, 24.0]) if random.random() < 0.7 else np.array([90.0, 60.0])
    c = float(frame[0] * random.uniform(0.5, 0.8))
    field = np.degrees(2.0 * np.arctan(0.5 * frame[0] / c))
    views = (photos + 1) // 2
    step = min(random.uniform(0.3, 0.45) * field, 360.0 / views)
    azimuth = np.radians(random.uniform(0.0, 360.0) + step * np.arange(views))
    view = np.repeat(np.arange(views), 2)[:photos]
    side = np.tile([-1.0, 1.0], views)[:photos]
    heading = azimuth[view] + np.radians(3.0) * random.normal(size=photos)
    across = np.column_stack([-np.sin(heading), np.cos(heading)])
    station = -0.35 * half.min() * np.column_stack([np.cos(azimuth), np.sin(azimuth)])
    base = half.min() * random.uniform(0.25, 0.5)
    centres = np.column_stack([station[view] + 0.5 * base * side[:, None] * across, np.zeros(photos)])
    centres[:, 2] = 0.4 * high + 0.08 * high * random.normal(size=photos)
    tilt = np.radians(4.0) * random.normal(size=photos) * (random.random() < 0.7)
    surface, normals = _walls(random, half, high, 60 * photos + 800, inside=True)
    return Scene(c, frame, centres, looking(_direction(heading, tilt), np.zeros(photos)), surface, normals)


def _building(random: np.random.Generator, photos: int) -> Scene:
    half = np.exp(random.uniform(np.log(4.0), np.log(25.0))) * np.array([1.0, random.uniform(0.5, 1.0)])
    high = half.min() * random.uniform(0.7, 1.6)
    frame = np.array([36.0, 24.0]) if random.random() < 0.7 else np.array([90.0, 60.0])
    c = float(frame[0] * random.uniform(0.6, 0.9))
    away = max(1.2 * high, 0.7 * half.max()) * random.uniform(0.9, 1.2)
    width = 2.0 * half
    # once around at the distance `away`: along the walls and in quarters of a circle around the corners
    turns = np.cumsum([0.0, *(length for side in (width[0], width[1]) * 2 for length in (side, 0.5 * np.pi * away))])
    base = min(random.uniform(0.2, 0.35) * away * frame[0] / c, turns[-1] / photos)
    path = (random.uniform(0.0, turns[-1]) + base * np.arange(photos) * random.uniform(0.9, 1.0)) % turns[-1]
    piece = np.searchsorted(turns, path, side="right") - 1
    part = path - turns[piece]
    wall, corner = piece // 2, piece % 2 == 1
    # the first wall is seen from -Y; the path goes on around to the left
    angle = np.radians(-90.0) + np.pi / 2.0 * wall + np.where(corner, part / away, 0.0)
    outward = np.column_stack([np.cos(angle), np.sin(angle)])
    starts = np.array([[-half[0], -half[1]], [half[0], -half[1]], [half[0], half[1]], [-half[0], half[1]]])
    ahead = np.column_stack([np.cos(np.pi / 2.0 * wall), np.sin(np.pi / 2.0 * wall)])
    foot = starts[wall] + ahead * np.where(corner, width[wall % 2], part)[:, None]
    centres = np.column_stack([foot + away * outward, np.zeros(photos)])
    centres[:, :2] += 0.04 * away * random.normal(size=(photos, 2))
    centres[:, 2] = 0.4 * high * random.uniform(0.6, 1.4, photos)
    heading = angle + np.pi + np.radians(5.0) * random.normal(size=photos)
    tilt = np.radians(4.0) * random.normal(size=photos) * (random.random() < 0.7)
    surface, normals = _walls(random, half, high, 80 * photos + 1500, inside=False)
    return Scene(c, frame, centres, looking(_direction(heading, tilt), np.zeros(photos)), surface, normals)


SCENES: dict[str, Callable[[np.random.Generator, int], Scene]] = {
    "aerial strips": aerial_strips,
    "convergent": convergent,
    "oblique strips": oblique_strips,
    "all-round": all_round,
}


def rows_and_columns(photos: int, rows: int) -> tuple[np.ndarray, np.ndarray]:
    """Return row and column of each photo; rows differ in length by one at the most."""
    parts = np.array_split(np.arange(photos), rows)
    return (
        np.concatenate([np.full(len(part), row) for row, part in enumerate(parts)]),
        np.concatenate([np.arange(len(part)) for part in parts]),
    )


def _pairs(row: np.ndarray, column: np.ndarray) -> tuple[tuple[int, int, int, int], ...]:
    neighbours = np.flatnonzero((row[1:] == row[:-1]) & (column[1:] == column[:-1] + 1))
    return tuple((int(i), int(i) + 1, int(row[i]) + 1, int(column[i]) + 1) for i in neighbours)


def _places(photos: int, strips: int) -> int:
    return 60 * photos + 200 * strips + 400


def _close_range_camera(random: np.random.Generator) -> tuple[float, np.ndarray]:
    c = float(np.exp(random.uniform(np.log(8.0), np.log(60.0))))
    if c < 14.0:
        return c, np.array([8.8, 6.6])
    if c < 40.0:
        return c, np.array([36.0, 24.0])
    return c, np.array([55.0, 55.0])


def _direction(azimuth: np.ndarray, elevation: np.ndarray) -> np.ndarray:
    """Return unit vectors (n, 3); azimuth from X to Y, radians."""
    return np.column_stack(
        [np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)]
    )


def looking(direction: np.ndarray, roll: np.ndarray) -> np.ndarray:
    """Return rotations (n, 3, 3) of cameras that look along vectors (n, 3), rolled (degrees) out of the upright."""
    back = -direction / np.linalg.norm(direction, axis=1, keepdims=True)
    right = np.cross(UP, back)
    right /= np.linalg.norm(right, axis=1, keepdims=True)
    upright = np.stack([right, np.cross(back, right), back], axis=-1)
    return np.asarray(upright @ Rotation.from_euler("Z", roll[:, None], degrees=True).as_matrix())


def relief(
    random: np.random.Generator, amplitude: float, extent: float
) -> Callable[[np.ndarray, np.ndarray], np.ndarray]:
    """Return heights of hills about `amplitude` high and some tenths of `extent` wide."""
    waves = 2.0 * np.pi / (extent * random.uniform(0.5, 2.0, 5))
    heading, phase = random.uniform(0.0, 2.0 * np.pi, (2, 5))

    def height(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        along = x[..., None] * np.cos(heading) + y[..., None] * np.sin(heading)
        return amplitude * np.sin(waves * along + phase).mean(axis=-1) * np.sqrt(2.0)

    return height


def height_field(
    random: np.random.Generator,
    along: tuple[float, float],
    across: tuple[float, float],
    height: Callable[[np.ndarray, np.ndarray], np.ndarray],
    places: int,
) -> tuple[np.ndarray, np.ndarray]:
    x, y = random.uniform(*along, places), random.uniform(*across, places)
    step = 1e-4 * (along[1] - along[0])
    slope_x = (height(x + step, y) - height(x - step, y)) / (2.0 * step)
    slope_y = (height(x, y + step) - height(x, y - step)) / (2.0 * step)
    normals = np.column_stack([-slope_x, -slope_y, np.ones(places)])
    return np.column_stack([x, y, height(x, y)]), normals / np.linalg.norm(normals, axis=1, keepdims=True)


def _ellipsoid(random: np.random.Generator, radius: float, places: int) -> tuple[np.ndarray, np.ndarray]:
    axes = radius * random.uniform(0.6, 1.0, 3)
    unit = random.normal(size=(places, 3))
    unit /= np.linalg.norm(unit, axis=1, keepdims=True)
    normals = unit / axes
    rough = 1.0 + 0.05 * random.normal(size=(places, 1))
    return axes * unit * rough, normals / np.linalg.norm(normals, axis=1, keepdims=True)


def _walls(
    random: np.random.Generator, half: np.ndarray, high: float, places: int, *, inside: bool
) -> tuple[np.ndarray, np.ndarray]:
    """Return places on the four walls over a rectangle, seen from inside or outside."""
    wall = random.choice(4, places, p=np.repeat(half[::-1], 2) / (2.0 * half.sum()))
    part = random.uniform(-1.0, 1.0, places)
    sign = np.where(wall % 2 == 0, 1.0, -1.0)
    of_x = wall < 2
    surface = np.column_stack(
        [
            half[0] * np.where(of_x, sign, part),
            half[1] * np.where(of_x, part, sign),
            high * random.uniform(size=places),
        ]
    )
    normals = np.column_stack([sign * of_x, sign * ~of_x, np.zeros(places)])
    return surface, -normals if inside else normals


def placed(scene: Scene, random: np.random.Generator, reach: float) -> Scene:
    """Return the scene turned about the vertical (half of them) and shifted (half of them)."""
    turned = random.uniform(0.0, 360.0) if random.random() < 0.5 else 0.0
    turn = Rotation.from_euler("Z", turned, degrees=True).as_matrix()
    shift = random.uniform(-reach, reach, 3) if random.random() < 0.5 else np.zeros(3)
    return replace(
        scene,
        centres=shift + scene.centres @ turn.T,
        rotations=turn @ scene.rotations,
        surface=shift + scene.surface @ turn.T,
        normals=scene.normals @ turn.T,
    )
