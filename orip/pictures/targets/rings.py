"""Rings around dots: the code of a dot is how many parts its ring has."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from orip.arrays import BoolArray, FloatArray
from orip.pictures.targets.dots import Dot

_STEP = 0.1
_FACTORS = np.arange(1.3, 6.01, _STEP)
"""Radii, in those of the dot, at which there may be a ring."""

_DIRECTIONS = 180

_SMALLEST_PART = 8
"""Directions, of two degrees: what is shorter is noise at the end of a part."""

_ALIKE = 1.3
"""Ratio of the axes of neighbouring dots."""

_LEAST_RADII = 13
"""Of `_FACTORS`, for how much a ring must be thick: 1.3 radii of the dot."""


PART_OF_RING = -1


def ring_codes(picture: Any, dots: Sequence[Dot]) -> tuple[int, ...]:
    """Return how many parts the ring around each dot has: 0 where there is none, -1 of what is part of a ring.

    A ring is dark, thick (at least 1.3 radii of the dot), divided into parts that begin and end with straight edges,
    and apart from its dot; it is seen in the same perspective as its dot.

    Parameters
    ----------
    picture : array (rows, columns) of uint8
    """
    rings = [_ring(picture, dot, dots) for dot in dots]
    codes = [ring.parts for ring in rings]
    for place in sorted(range(len(dots)), key=lambda place: -rings[place].thickness):
        if codes[place] > 0:
            for other in _within(dots[place], rings[place].outer, dots):
                codes[other] = PART_OF_RING
    return tuple(codes)


class _Ring(NamedTuple):
    """Parts of a ring (0: there is none), its thickness and its outer radius in radii of the dot."""

    parts: int
    thickness: float
    outer: float


_NO_RING = _Ring(0, 0.0, 0.0)


def _ring(picture: Any, dot: Dot, dots: Sequence[Dot]) -> _Ring:
    dark = _darkness(picture, dot)
    _blank_out(dark, dot, dots)
    covered = dark.mean(axis=1)
    if covered[:2].max() > 0.05:  # something touches the dot, or the ground is not light
        return _NO_RING
    is_ring = np.append(covered > 0.15, False)
    begin = int(np.argmax(is_ring))
    thickness = int(np.argmin(is_ring[begin:]))
    if thickness < _LEAST_RADII or begin + thickness == len(covered):
        return _NO_RING
    along = dark[begin + thickness // 4 : begin + thickness - thickness // 4].mean(axis=0)
    # a direction is within a part or between two; a neighbour or a shadow is neither all along
    if np.mean((along > 0.15) & (along < 0.85)) > 0.15:
        return _NO_RING
    return _Ring(_parts(along > 0.5), thickness * _STEP, _FACTORS[begin] + thickness * _STEP)


def _within(dot: Dot, radius: float, dots: Sequence[Dot]) -> list[int]:
    return [
        place
        for place, other in enumerate(dots)
        if other is not dot
        and np.linalg.norm(dot.shape @ (other.column - dot.column, other.row - dot.row)) < radius
        and not _are_alike(dot, other)
    ]


def _darkness(picture: Any, dot: Dot) -> BoolArray:
    """Return what is dark at radii (rows) and in directions (columns) about a dot."""
    angles = np.arange(_DIRECTIONS) * (2.0 * np.pi / _DIRECTIONS)
    circle = np.linalg.inv(dot.shape) @ np.stack([np.cos(angles), np.sin(angles)])
    at = np.array([dot.column, dot.row])[:, None, None] + circle[:, None, :] * _FACTORS[:, None]
    columns, rows = np.floor(at).astype(int)
    inside = (columns >= 0) & (rows >= 0) & (columns < picture.shape[1]) & (rows < picture.shape[0])
    values = picture[np.where(inside, rows, 0), np.where(inside, columns, 0)]
    return np.asarray(inside & (values < dot.ground - 0.5 * dot.contrast))


def _blank_out(dark: BoolArray, dot: Dot, dots: Sequence[Dot]) -> None:
    """Take the neighbours of a dot out of what is dark about it."""
    for other in dots:
        away = np.array([other.column - dot.column, other.row - dot.row])
        if other is dot or np.hypot(*away) > 12.0 * max(dot.radius, other.radius) or not _are_alike(dot, other):
            continue
        radius = np.linalg.norm(dot.shape @ away)
        if radius < 1.3 + _FACTORS[-1]:
            _blank(dark, dot.shape @ away, 1.3 * other.radius / dot.radius)


def _are_alike(dot: Dot, other: Dot) -> bool:
    """Tell whether two dots have the same size and perspective; parts of rings may look like dots, but not these."""
    ratios = np.linalg.svd(dot.shape @ np.linalg.inv(other.shape))[1]
    return bool(ratios.min() > 1.0 / _ALIKE and ratios.max() < _ALIKE)


def _blank(dark: BoolArray, centre: FloatArray, radius: float) -> None:
    angles = np.arange(_DIRECTIONS) * (2.0 * np.pi / _DIRECTIONS)
    x = np.outer(_FACTORS, np.cos(angles)) - centre[0]
    y = np.outer(_FACTORS, np.sin(angles)) - centre[1]
    dark[np.hypot(x, y) < radius] = False


def _parts(is_dark: BoolArray) -> int:
    if is_dark.all() or not is_dark.any():
        return 0
    changes = np.flatnonzero(is_dark != np.roll(is_dark, 1))
    lengths = np.diff(np.append(changes, changes[0] + len(is_dark)))
    return 0 if lengths.min() < _SMALLEST_PART else len(changes) // 2
