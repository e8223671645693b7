"""Parts of a block placed on the ground together, though no two of them share enough points to be joined alone.

Each part (a strip, a model, a photo) is levelled by the attitude of its photos. The rest of its similarity is linear:
scale, azimuth and shift in plan, then the height. All parts are therefore adjusted together without initial
values, from control and common points, as in the block adjustment of levelled models (Anblock: van den Hout 1966).
Levels are improved with the heights.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from orip.arrays import BoolArray, FloatArray, IntArray
from orip.geometry.rotation import cross_matrix
from orip.geometry.similarity import Similarity
from orip.prelim.similarity.partial_blocks import transformed
from orip.records.preliminary import PartialBlock

_AGREEING = 0.5
"""Length of the mean of the photos' axes below which they do not say where up is."""

_ALIKE = 0.03
"""Weight of the condition that parts with a common photo have the same scale and azimuth; 1 is that of a point."""

_LEVEL = 0.1
"""Weight of the condition that a part is level, at the distance of its points; 1 is that of a point."""

_ROUNDS = 3
"""Number of adjustments of plan and height."""

_SMALLEST_SCALE = 0.2
"""Part of the median scale; parts that shrink to less are not determined."""


@dataclass(frozen=True, slots=True)
class _Ties:
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


def place_parts(parts: Sequence[PartialBlock], known: FloatArray, axis: int) -> list[PartialBlock] | None:
    """Place parts of a block on the ground together.

    Parameters
    ----------
    parts : sequence of PartialBlock
        Each in its own system, all at similar scale; a photo may be in several.
    known : array (number of points, 3)
        Coordinates of control; NaN where not known.
    axis : int
        Axis of the photos that points up: 2 where they look down, 1 where they stand upright.

    Returns
    -------
    list of PartialBlock, or None
        None where photos of a part contradict each other, or the parts are not determined together.
    """
    level = [_levelled(part, axis) for part in parts]
    placed = [part for part in level if part is not None]
    if len(placed) < len(parts):
        return None
    placed = _with_common_azimuths(placed)
    for _ in range(_ROUNDS):
        moved = _adjusted(placed, known)
        if moved is None:
            return None
        placed = moved
    return placed


def _levelled(part: PartialBlock, axis: int) -> PartialBlock | None:
    mean = part.rotations[:, :, axis].mean(axis=0)
    length = float(np.linalg.norm(mean))
    if length < _AGREEING:
        return None
    return transformed(part, Similarity(1.0, _turn_to_up(mean / length), np.zeros(3)))


def _turn_to_up(direction: FloatArray) -> FloatArray:
    """Return the smallest rotation that takes a direction (3,) to the vertical."""
    up = np.array([0.0, 0.0, 1.0])
    across, cosine = cross_matrix(np.cross(direction, up)), float(direction @ up)
    if cosine < -1.0 + 1e-12:
        return np.diag([1.0, -1.0, -1.0])
    return np.asarray(np.eye(3) + across + across @ across / (1.0 + cosine))


def _with_common_azimuths(parts: Sequence[PartialBlock]) -> list[PartialBlock]:
    """Return parts of which those with a common photo have the same azimuth."""
    placed: dict[int, PartialBlock] = {}
    for first in range(len(parts)):
        if first in placed:
            continue
        placed[first], waiting = parts[first], [first]
        while waiting:
            here = placed[waiting.pop()]
            for other in range(len(parts)):
                common = np.intersect1d(here.photos, parts[other].photos)
                if other not in placed and len(common):
                    placed[other] = _turned_like(parts[other], here, int(common[0]))
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
    plan = _in_plan(ties, coordinates, _alike(parts))
    scale = np.hypot(plan[:, 0], plan[:, 1])
    if not np.isfinite(plan).all() or scale.min() < _SMALLEST_SCALE * np.median(scale):
        return None
    azimuth = np.arctan2(plan[:, 1], plan[:, 0])
    similarities = [
        Similarity(float(size), _about_up(turn), np.array([*shift, 0.0]))
        for size, turn, shift in zip(scale, azimuth, plan[:, 2:], strict=True)
    ]
    turned = [transformed(part, similarity) for part, similarity in zip(parts, similarities, strict=True)]
    ties, coordinates = _ties(turned, known)
    middle = np.array([part.coordinates.mean(axis=0) for part in turned])
    height = _in_height(ties, coordinates - middle[ties.part])
    return [
        transformed(part, _lifted(centre, *values)) for part, centre, values in zip(turned, middle, height, strict=True)
    ]


def _lifted(middle: FloatArray, slope_x: float, slope_y: float, lift: float) -> Similarity:
    """Return the movement that takes the middle of a part to a height, and tilts the part there."""
    normal = np.array([-slope_x, -slope_y, 1.0])
    rotation = _turn_to_up(normal / np.linalg.norm(normal)).T
    return Similarity(1.0, rotation, np.array([*middle[:2], lift]) - rotation @ middle)


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
    return [
        (one, other)
        for one in range(len(parts))
        for other in range(one + 1, len(parts))
        if len(np.intersect1d(parts[one].photos, parts[other].photos))
    ]


def _in_plan(ties: _Ties, coordinates: FloatArray, alike: Sequence[tuple[int, int]]) -> FloatArray:
    """Return a, b, shift in X and Y of each part (parts, 4): X = a x - b y + shift, Y = b x + a y + shift."""
    parts, n = ties.parts, len(ties.part)
    free: BoolArray = np.asarray(~np.isfinite(ties.known[:, :2]).all(axis=1))
    column = 4 * parts + 2 * (np.cumsum(free) - 1)
    size = float(np.sqrt((coordinates[:, :2] ** 2).sum(axis=1).mean())) or 1.0
    design = np.zeros((2 * n + 2 * len(alike), 4 * parts + 2 * np.count_nonzero(free)))
    right = np.zeros(len(design))
    rows, at = 2 * np.arange(n), 4 * ties.part
    x, y = coordinates[:, 0], coordinates[:, 1]
    design[rows, at], design[rows, at + 1], design[rows, at + 2] = x, -y, size
    design[rows + 1, at], design[rows + 1, at + 1], design[rows + 1, at + 3] = y, x, size
    unknown = free[ties.place]
    design[rows[unknown], column[ties.place[unknown]]] = -size
    design[rows[unknown] + 1, column[ties.place[unknown]] + 1] = -size
    middle = np.nanmean(ties.known[~free, :2], axis=0) if (~free).any() else np.zeros(2)
    given = ties.known[ties.place[~unknown], :2] - middle
    right[rows[~unknown]], right[rows[~unknown] + 1] = given.T
    for row, (one, other) in enumerate(alike):
        for component in range(2):
            columns = [4 * one + component, 4 * other + component]
            design[2 * n + 2 * row + component, columns] = _ALIKE * size, -_ALIKE * size
    solution = np.linalg.lstsq(design, right, rcond=1e-9)[0][: 4 * parts].reshape(parts, 4)
    solution[:, 2:] = solution[:, 2:] * size + middle
    return np.asarray(solution)


def _in_height(ties: _Ties, coordinates: FloatArray) -> FloatArray:
    """Return slopes in X and Y, and height, at the middle of each part (parts, 3), to which coordinates refer."""
    parts, n = ties.parts, len(ties.part)
    free: BoolArray = np.asarray(~np.isfinite(ties.known[:, 2]))
    column = 3 * parts + np.cumsum(free) - 1
    size = float(np.sqrt((coordinates[:, :2] ** 2).sum(axis=1).mean())) or 1.0
    design = np.zeros((n + 2 * parts, 3 * parts + np.count_nonzero(free)))
    right = np.zeros(len(design))
    rows, at = np.arange(n), 3 * ties.part
    design[rows, at], design[rows, at + 1], design[rows, at + 2] = coordinates[:, 0], coordinates[:, 1], size
    unknown = free[ties.place]
    design[rows[unknown], column[ties.place[unknown]]] = -size
    datum = float(np.mean(ties.known[~free, 2])) if (~free).any() else 0.0
    right[rows] = -coordinates[:, 2]
    right[rows[~unknown]] += ties.known[ties.place[~unknown], 2] - datum
    for part in range(parts):
        for component in range(2):
            design[n + 2 * part + component, 3 * part + component] = _LEVEL * size
    solution = np.linalg.lstsq(design, right, rcond=1e-9)[0][: 3 * parts].reshape(parts, 3)
    solution[:, 2] = solution[:, 2] * size + datum
    return np.asarray(solution)
