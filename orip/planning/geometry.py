"""Geometry of flight lines: footprint, base and spacing that hold overlaps over relief, and strips over an area."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from msgspec import Struct

from orip.arrays import FloatArray
from orip.errors import InputError

MOST_PHOTOS = 100_000
"""A plan with more is a mistake of units, and would take all memory."""

Terrain = Callable[[FloatArray], FloatArray]
"""Heights (n,) of places (n, 2)."""

_TERRAIN_NODES = 120
"""Of each side of the area: what rises between them, such as a tower, is not seen."""


class Frame(NamedTuple):
    """The camera as a flight sees it: principal distance, sides along and across the flight, size of a pixel; mm."""

    c: float
    along: float
    across: float
    pixel: float


class Wanted(Struct, frozen=True):
    """What strips are to be like; ground units, overlaps as parts of 1, angles in radians.

    Parameters
    ----------
    height : float
        Above ground.
    crab : float
        Angle between photos and strip at which the overlaps still hold.
    follow : bool
        Each photo at its height above ground; else all at one height, above the mean of the ground.
    """

    height: float
    forward: float
    side: float
    crab: float = 0.0
    margin: float = 0.0
    follow: bool = False


class Strip(Struct, frozen=True):
    """A strip: its exposures (n, 3) in the order of flight, and its azimuth (radians, from Y to X)."""

    places: FloatArray
    azimuth: float


def height_of_pixel(frame: Frame, pixel: float) -> float:
    """Return the height above ground at which a pixel has a size on the ground."""
    return pixel * frame.c / frame.pixel


def advance(overlap: float, own: float, other: float, crab: float) -> float:
    """Return by how much a photo is moved so that a part of its ground is still in the next one.

    With s the side along the movement, w the other one, and the photo turned by chi against the movement, the common
    part is (1 - b cos chi / s) (1 - b sin chi / w): of its two solutions the smaller one.

    Parameters
    ----------
    overlap : float
        0 to below 1.
    own, other : float
        Sides of the footprint, ground unit.
    crab : float
        Radians.
    """
    one, two = math.cos(crab) / own, abs(math.sin(crab)) / other
    if two == 0.0:
        return (1.0 - overlap) / one
    total, product = one + two, one * two
    return (total - math.sqrt(total**2 - 4.0 * product * (1.0 - overlap))) / (2.0 * product)


def least_height(frame: Frame, terrain: Terrain, places: FloatArray, height: float) -> float:
    """Return the least height (above ground) of photos following the ground, over all that each of them shows.

    Parameters
    ----------
    places : array (n, 2)
    height : float
        Above the ground below the photos.
    """
    reach = 0.5 * height * math.hypot(frame.along, frame.across) / frame.c
    around = np.linspace(0.0, 2.0 * math.pi, 16, endpoint=False)
    below = terrain(places)
    least = height
    for part in (0.25, 0.5, 0.75, 1.0):
        ring = part * reach * np.column_stack([np.cos(around), np.sin(around)])
        higher = terrain((places[:, None] + ring).reshape(-1, 2)).reshape(len(places), -1) - below[:, None]
        least = min(least, height - float(np.nanmax(higher)))
    return least


def strips_over(corners: FloatArray, frame: Frame, wanted: Wanted, terrain: Terrain, azimuth: float) -> list[Strip]:
    """Return parallel strips over an area, flown there and back.

    The first and the last strip, and the first and the last photo of a strip, are on the border (with its margin) or
    beyond it, by half a spacing or base at most.

    Parameters
    ----------
    corners : array (n, 2)
        Of a simple polygon.
    azimuth : float
        Of the first strip, radians.

    Raises
    ------
    InputError
        Where the ground is higher than the flight, or there would be too many photos.
    """
    turn = np.array([[math.sin(azimuth), math.cos(azimuth)], [math.cos(azimuth), -math.sin(azimuth)]])
    own = corners @ turn.T  # along, across
    low, high = own.min(axis=0) - wanted.margin, own.max(axis=0) + wanted.margin
    ground = _grid(low, high, _TERRAIN_NODES) @ turn
    heights = terrain(ground)
    reference = float(np.nanmean(heights))
    clear = _clearance(frame, wanted, terrain, ground, heights, reference)
    scale = clear / frame.c
    spacing = advance(wanted.side, frame.across * scale, frame.along * scale, wanted.crab)
    base = advance(wanted.forward, frame.along * scale, frame.across * scale, wanted.crab)
    _refuse_too_many((high - low) / [base, spacing])
    across = _evenly(low[1], high[1], spacing)
    found = []
    for number, offset in enumerate(across.tolist()):
        reached = _reached(own, offset, 0.5 * spacing + wanted.margin)
        if reached is None:
            continue
        start, end = reached[0] - wanted.margin, reached[1] + wanted.margin
        along = _evenly(start, end, base)
        along, heading = (along, azimuth) if number % 2 == 0 else (along[::-1], azimuth + math.pi)
        places = np.column_stack([along, np.full(len(along), offset)]) @ turn
        z = terrain(places) if wanted.follow else np.full(len(places), reference)
        found.append(Strip(np.column_stack([places, z + wanted.height]), heading))
    return found


def strips_along(line: FloatArray, width: float, frame: Frame, wanted: Wanted, terrain: Terrain) -> list[Strip]:
    """Return strips along each piece of a line, side by side over its width.

    Parameters
    ----------
    line : array (n, 2)
    width : float
        Both sides together.
    frame, wanted, terrain
        See `strips_over`.
    """
    found: list[Strip] = []
    for start, end in itertools.pairwise(line):
        ahead = (end - start) / np.linalg.norm(end - start)
        right = 0.5 * width * np.array([ahead[1], -ahead[0]])
        corners = np.array([start - right, end - right, end + right, start + right])
        found += strips_over(corners, frame, wanted, terrain, math.atan2(ahead[0], ahead[1]))
    return found


def best_azimuth(corners: FloatArray, cost: Callable[[float], float]) -> float:
    """Return the direction of least cost: one of the sides of the area, where its width is least.

    The least width of a polygon is at right angles to one of the sides of its convex hull (Freeman and Shapira 1975).
    """
    from scipy.spatial import ConvexHull

    hull = corners[ConvexHull(corners).vertices]
    sides = np.roll(hull, -1, axis=0) - hull
    azimuths = np.unique(np.round(np.mod(np.arctan2(sides[:, 0], sides[:, 1]), math.pi), 9))
    return float(min(azimuths.tolist(), key=cost))


def footprint(frame: Frame, centre: FloatArray, rotation: FloatArray, size: FloatArray, ground: float) -> FloatArray:
    """Return the corners (4, 2) of a photo on level ground; NaN for a corner that looks above the horizon.

    Parameters
    ----------
    centre : array (3,)
    rotation : array (3, 3)
        Photo to ground.
    size : array (2,)
        Of the photo in x and y, mm.
    """
    corners = 0.5 * np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]) * size
    rays = np.column_stack([corners, np.full(4, -frame.c)]) @ rotation.T
    with np.errstate(divide="ignore"):
        scale = np.where(rays[:, 2] < 0.0, (ground - centre[2]) / rays[:, 2], np.nan)
    return np.asarray(centre[:2] + scale[:, None] * rays[:, :2])


def _clearance(
    frame: Frame, wanted: Wanted, terrain: Terrain, ground: FloatArray, heights: FloatArray, reference: float
) -> float:
    """Return the least height above the ground that photos show, over which all overlaps are to hold."""
    if wanted.follow:
        clear = least_height(frame, terrain, ground[np.isfinite(heights)], wanted.height)
    else:
        clear = reference + wanted.height - float(np.nanmax(heights))
    if clear <= 0.0:
        message = (
            f"the ground rises {wanted.height - clear:.1f} above that below the photos, which fly {wanted.height:.1f} "
            "above it; fly higher, or write follow = true in [plan]"
        )
        raise InputError.single(message, "orip.toml")
    return clear


def _reached(own: FloatArray, offset: float, half: float) -> tuple[float, float] | None:
    """Return from where to where the area reaches within a band along a strip; None: it does not."""
    ends = np.roll(own, -1, axis=0)
    found = [own[np.abs(own[:, 1] - offset) <= half, 0]]
    for border in (offset - half, offset + half):
        rise = ends[:, 1] - own[:, 1]
        with np.errstate(divide="ignore", invalid="ignore"):
            part = (border - own[:, 1]) / rise
        crossed = (rise != 0.0) & (part >= 0.0) & (part <= 1.0)
        found.append((own[:, 0] + part * (ends[:, 0] - own[:, 0]))[crossed])
    along = np.concatenate(found)
    return (float(along.min()), float(along.max())) if len(along) else None


def _evenly(low: float, high: float, step: float) -> FloatArray:
    """Return places a step apart, in the middle between two borders that the first and the last reach."""
    count = math.ceil((high - low) / step - 1e-9) + 1
    return np.asarray(0.5 * (low + high) + step * (np.arange(count) - 0.5 * (count - 1)), dtype=np.float64)


def _grid(low: FloatArray, high: FloatArray, count: int) -> FloatArray:
    x, y = np.meshgrid(*(np.linspace(a, b, count) for a, b in zip(low, high, strict=True)))
    return np.column_stack([x.ravel(), y.ravel()])


def _refuse_too_many(counts: FloatArray) -> None:
    photos = float(np.prod(counts + 2.0))
    if photos > MOST_PHOTOS:
        message = (
            f"the flight would have about {photos:.3g} photos, more than {MOST_PHOTOS}; check area, height and "
            "overlaps in [plan], or divide the area"
        )
        raise InputError.single(message, "orip.toml")
