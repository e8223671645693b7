"""Parts of a block placed on the ground together, though no two of them share enough points to be joined alone.

Each part (a strip, a model, a photo) is levelled by the attitude of its photos. The other unknowns of its similarity
are linear: scale, azimuth and shift in plan, then the height. All parts are therefore adjusted together without initial
values, from control and common points, as in the block adjustment of levelled models (Anblock: van den Hout 1966).
Levels are improved with the heights.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from msgspec import Struct

from orip.arrays import BoolArray, FloatArray, IntArray
from orip.geometry.similarity import Similarity
from orip.prelim.similarity.partial_blocks import transformed
from orip.records.results.preliminary import PartialBlock

_AGREEING = 0.5
"""Length of the mean of the photos' axes below which they do not say where up is."""

_ALIKE = 0.03
"""Weight of the condition that parts with a common photo have the same scale and azimuth; 1 is that of a point."""

_LEVEL = 0.1
"""Weight of the condition that a part is level, at the distance of its points; 1 is that of a point."""

_ROUNDS = 3
"""Number of adjustments of plan and height."""

_SMALLEST_SCALE = 0.2
"""Of the median scale: parts that shrink more are not determined, and get the median."""

_DENSE = 300
"""Unknowns up to which setting up a sparse matrix takes longer than solving a full one."""

_REGULAR = 1e-10
"""Of the mean square of a column, added to the normal equations: parts that nothing ties stay where they are."""


class _Ties(Struct, frozen=True):
    """What parts have in common with each other and with control.

    Parameters
    ----------
    parts : int
    part : array (n,) of int
    place : array (n,) of int
        Index of a ground position: that of a point, or of the projection centre of a photo.
    known : array (number of places, 3)
        Ground coordinates; NaN where not known.
    """

    parts: int
    part: IntArray
    place: IntArray
    known: FloatArray


def place_parts(parts: Sequence[PartialBlock], known: FloatArray) -> list[PartialBlock] | None:
    """Place parts of a block on the ground together.

    Parameters
    ----------
    parts : sequence of PartialBlock
        Each in its own system, levelled, all at similar scale; a photo may be in several.
    known : array (number of points, 3)
        Coordinates of control; NaN where not known.

    Returns
    -------
    list of PartialBlock, or None
        None where control and common points do not determine the parts together.
    """
    if not parts:
        return None
    placed = _with_common_azimuths(parts)
    for _ in range(_ROUNDS):
        moved = _adjusted(placed, known)
        if moved is None:
            return None
        placed = moved
    return placed


def levelled(part: PartialBlock, axis: int) -> PartialBlock | None:
    """Return a part turned so that the mean axis of its photos points up; None where their axes contradict each other.

    Parameters
    ----------
    part : PartialBlock
    axis : int
        Axis of the photos that points up: 2 where they look down, 1 where they stand upright.
    """
    mean = part.rotations[:, :, axis].mean(axis=0)
    length = float(np.linalg.norm(mean))
    if length < _AGREEING:
        return None
    return transformed(part, Similarity(1.0, _turn_to_up(mean / length), np.zeros(3)))


def tilted(part: PartialBlock, slope_x: float, slope_y: float) -> PartialBlock:
    """Return a part turned so that its horizontal plane gets slopes in X and Y."""
    return transformed(part, Similarity(1.0, _turn_to_slopes(slope_x, slope_y), np.zeros(3)))


def _turn_to_up(direction: FloatArray) -> FloatArray:
    """Return the smallest rotation that takes a direction (3,) to the vertical."""
    x, y, z = direction.tolist()
    if z < -1.0 + 1e-12:
        return np.diag([1.0, -1.0, -1.0])
    # I + [a]x + [a]x [a]x / (1 + cosine), with a = direction x vertical
    a, b = x / (1.0 + z), y / (1.0 + z)
    return np.array([[1.0 - a * x, -a * y, -x], [-b * x, 1.0 - b * y, -y], [x, y, 1.0 - a * x - b * y]])


def _with_common_azimuths(parts: Sequence[PartialBlock]) -> list[PartialBlock]:
    """Return parts of which those with a common photo have the same azimuth."""
    placed: dict[int, PartialBlock] = {}
    photos = [set(part.photos.tolist()) for part in parts]
    for first in range(len(parts)):
        if first in placed:
            continue
        placed[first], waiting = parts[first], [first]
        while waiting:
            here = waiting.pop()
            for other in range(len(parts)):
                if other not in placed and (common := photos[here] & photos[other]):
                    placed[other] = _turned_like(parts[other], placed[here], min(common))
                    waiting.append(other)
    return [placed[number] for number in range(len(parts))]


def _turned_like(part: PartialBlock, other: PartialBlock, photo: int) -> PartialBlock:
    mine, its = (block.rotations[np.flatnonzero(block.photos == photo)[0]] for block in (part, other))
    turn = its @ mine.T
    azimuth = np.arctan2(turn[1, 0] - turn[0, 1], turn[0, 0] + turn[1, 1])
    return transformed(part, Similarity(1.0, _about_up(azimuth), np.zeros(3)))


def _about_up(azimuth: float) -> FloatArray:
    c, s = np.cos(azimuth), np.sin(azimuth)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def _adjusted(parts: Sequence[PartialBlock], known: FloatArray) -> list[PartialBlock] | None:
    """Return parts after an adjustment of all in plan, then of their heights and levels."""
    ties, coordinates = _ties(parts, known)
    middle = _middles(ties, coordinates)
    plan = _in_plan(ties, coordinates - middle[ties.part], _alike(parts))
    scale = np.hypot(plan[:, 0], plan[:, 1])
    if not np.isfinite(plan).all() or not scale.any():
        return None
    usual = float(np.median(scale[scale > 0.0]))
    scale = np.where(scale < _SMALLEST_SCALE * usual, usual, scale)
    turned = [
        transformed(part, _moved_in_plan(centre, values, float(size)))
        for part, centre, values, size in zip(parts, middle, plan, scale, strict=True)
    ]
    ties, coordinates = _ties(turned, known)
    middle = _middles(ties, coordinates)
    height = _in_height(ties, coordinates - middle[ties.part])
    return [
        transformed(part, _lifted(centre, *values)) for part, centre, values in zip(turned, middle, height, strict=True)
    ]


def _middles(ties: _Ties, coordinates: FloatArray) -> FloatArray:
    """Return the means (parts, 3) of the coordinates by which parts are tied."""
    number = np.maximum(np.bincount(ties.part, minlength=ties.parts), 1)
    sums = [np.bincount(ties.part, weights=column, minlength=ties.parts) for column in coordinates.T]
    return np.stack(sums, axis=1) / number[:, None]


def _moved_in_plan(middle: FloatArray, plan: FloatArray, scale: float) -> Similarity:
    """Return the movement of a part at a scale, its middle to where a row (4,) of `_in_plan` has it."""
    a, b, x, y = plan
    rotation = _about_up(np.arctan2(b, a))
    return Similarity(scale, rotation, np.array([x, y, 0.0]) - scale * (rotation @ [*middle[:2], 0.0]))


def _lifted(middle: FloatArray, slope_x: float, slope_y: float, lift: float) -> Similarity:
    """Return the movement that takes the middle of a part to a height, and tilts the part there."""
    rotation = _turn_to_slopes(slope_x, slope_y)
    return Similarity(1.0, rotation, np.array([*middle[:2], lift]) - rotation @ middle)


def _turn_to_slopes(slope_x: float, slope_y: float) -> FloatArray:
    """Return the smallest rotation that gives the horizontal plane slopes in X and Y."""
    normal = np.array([-slope_x, -slope_y, 1.0])
    return _turn_to_up(normal / np.linalg.norm(normal)).T


def _ties(parts: Sequence[PartialBlock], known: FloatArray) -> tuple[_Ties, FloatArray]:
    """Return what ties the parts, and the coordinates (n, 3) that each part has for it."""
    count = len(known)
    number = np.concatenate([np.full(len(part.points) + len(part.photos), k) for k, part in enumerate(parts)])
    place = np.concatenate([array for part in parts for array in (part.points, count + part.photos)])
    coordinates = np.concatenate([array for part in parts for array in (part.coordinates, part.centres)])
    photos = max(int(part.photos.max()) for part in parts) + 1
    on_ground = np.vstack([known, np.full((photos, 3), np.nan)])
    shared = np.bincount(place, minlength=len(on_ground)) > 1
    useful = (shared | np.isfinite(on_ground).any(axis=1))[place]
    places, new = np.unique(place[useful], return_inverse=True)
    return _Ties(len(parts), number[useful], new, on_ground[places]), coordinates[useful]


def _alike(parts: Sequence[PartialBlock]) -> list[tuple[int, int]]:
    """Return pairs of parts with a common photo."""
    photos = [set(part.photos.tolist()) for part in parts]
    return [
        (one, other)
        for one in range(len(parts))
        for other in range(one + 1, len(parts))
        if not photos[one].isdisjoint(photos[other])
    ]


def _in_plan(ties: _Ties, coordinates: FloatArray, alike: Sequence[tuple[int, int]]) -> FloatArray:
    """Return a, b and plan of the middle of each part (parts, 4), from which coordinates are taken.

    X = a x - b y + X of the middle, Y = b x + a y + Y of the middle.
    """
    parts, n = ties.parts, len(ties.part)
    free: BoolArray = np.asarray(~np.isfinite(ties.known[:, :2]).all(axis=1))
    column = 4 * parts + 2 * (np.cumsum(free) - 1)
    size = _size(coordinates)
    x, y, ones = coordinates[:, 0], coordinates[:, 1], np.full(n, size)
    unknown = free[ties.place]
    middle = np.nanmean(ties.known[~free, :2], axis=0) if (~free).any() else np.zeros(2)
    given = np.where(unknown[:, None], 0.0, ties.known[ties.place, :2] - middle)
    equations, at, of_point = _Equations(4 * parts + 2 * int(free.sum())), 4 * ties.part, column[ties.place]
    for component, (for_a, for_b) in enumerate(((x, -y), (y, x))):
        equations.add(
            (at, at + 1, at + 2 + component, np.where(unknown, of_point + component, 0)),
            (for_a, for_b, ones, np.where(unknown, -size, 0.0)),
            given[:, component],
        )
    one, other = np.array(alike, dtype=np.int64).reshape(-1, 2).T
    for component in range(2):
        columns = 4 * one + component, 4 * other + component
        equations.add(
            columns, (np.full(len(one), _ALIKE * size), np.full(len(one), -_ALIKE * size)), np.zeros(len(one))
        )
    solution = equations.solved()[: 4 * parts].reshape(parts, 4)
    solution[:, 2:] = solution[:, 2:] * size + middle
    return solution


def _in_height(ties: _Ties, coordinates: FloatArray) -> FloatArray:
    """Return slopes in X and Y, and height, at the middle of each part (parts, 3), to which coordinates refer."""
    parts = ties.parts
    free: BoolArray = np.asarray(~np.isfinite(ties.known[:, 2]))
    column = 3 * parts + np.cumsum(free) - 1
    size = _size(coordinates)
    unknown, at = free[ties.place], 3 * ties.part
    datum = float(np.mean(ties.known[~free, 2])) if (~free).any() else 0.0
    given = np.where(unknown, 0.0, ties.known[ties.place, 2] - datum)
    equations = _Equations(3 * parts + int(free.sum()))
    equations.add(
        (at, at + 1, at + 2, np.where(unknown, column[ties.place], 0)),
        (coordinates[:, 0], coordinates[:, 1], np.full(len(at), size), np.where(unknown, -size, 0.0)),
        given - coordinates[:, 2],
    )
    slopes = np.flatnonzero(np.arange(3 * parts) % 3 < 2)
    equations.add((slopes,), (np.full(len(slopes), _LEVEL * size),), np.zeros(len(slopes)))
    solution = equations.solved()[: 3 * parts].reshape(parts, 3)
    solution[:, 2] = solution[:, 2] * size + datum
    return solution


def _size(coordinates: FloatArray) -> float:
    return float(np.sqrt((coordinates[:, :2] ** 2).sum(axis=1).mean())) or 1.0


class _Equations:
    """Linear equations with few unknowns each, to be solved by least squares."""

    def __init__(self, columns: int) -> None:
        self._columns, self._count = columns, 0
        self._parts: list[tuple[IntArray, IntArray, FloatArray]] = []
        self._right: list[FloatArray] = []

    def add(self, columns: Sequence[IntArray], values: Sequence[FloatArray], right: FloatArray) -> None:
        """Add n equations: for each of their terms the columns (n,) and values (n,), and their right sides (n,)."""
        rows = self._count + np.arange(len(right))
        self._parts += [(rows, column, value) for column, value in zip(columns, values, strict=True)]
        self._right.append(right)
        self._count += len(right)

    def solved(self) -> FloatArray:
        """Return the unknowns (columns,); those that nothing determines are near 0."""
        rows, columns, values = (np.concatenate(part) for part in zip(*self._parts, strict=True))
        right = np.concatenate(self._right)
        if self._columns <= _DENSE:
            design = np.zeros((self._count, self._columns))
            np.add.at(design, (rows, columns), values)
            normal = design.T @ design
            regular = _REGULAR * float(normal.diagonal().mean()) * np.eye(self._columns)
            return np.asarray(np.linalg.solve(normal + regular, design.T @ right))
        return self._solved_sparse(rows, columns, values, right)

    def _solved_sparse(self, rows: IntArray, columns: IntArray, values: FloatArray, right: FloatArray) -> FloatArray:
        from scipy.sparse import coo_array, eye_array
        from scipy.sparse.linalg import splu

        design = coo_array((values, (rows, columns)), shape=(self._count, self._columns)).tocsc()
        normal = (design.T @ design).tocsc()
        regular = _REGULAR * float(normal.diagonal().mean()) * eye_array(self._columns, format="csc")
        return np.asarray(splu((normal + regular).tocsc()).solve(design.T @ right))
