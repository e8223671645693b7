"""The states of all rays at once, as a page draws them: without testing each one again."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

from orip.online.answers import State
from orip.online.measuring import Measuring
from orip.sequential.observation_rows import ObservationKey

_CHECKED_RAYS = 3
"""Rays from which an error of one of them shows in every direction."""


class RayState(NamedTuple):
    """A photo point, its stored coordinates and its state."""

    photo: str
    point: str
    xy: tuple[float, float]
    state: State


def ray_states(measuring: Measuring) -> Iterator[RayState]:
    """Yield all photo points that are measured, photo by photo.

    Whether one is checked is told by the number of rays, and by control; an answer tells it from redundancy numbers.
    """
    block = measuring.block
    included, is_checked = block.equations.included, _checked_points(measuring)
    for photo in block.measurements.photos:
        for point in block.measurements.points_in(photo):
            key = ObservationKey("photo", photo, point)
            xy = block.measurements.at(photo, point)
            assert xy is not None, "it is measured"
            if key in measuring.excluded:
                yield RayState(photo, point, xy, "excluded")
            elif key in measuring.suspects:
                yield RayState(photo, point, xy, "suspect")
            elif key not in included:
                yield RayState(photo, point, xy, "waiting")
            else:
                yield RayState(photo, point, xy, "included" if point in is_checked else "unchecked")


def _checked_points(measuring: Measuring) -> set[str]:
    """Return the points with control, or with as many rays as check each other."""
    rays: dict[str, int] = {}
    for key in measuring.block.equations.included:
        rays[key.point] = rays.get(key.point, 0) + (_CHECKED_RAYS if key.kind == "control" else 1)
    return {point for point, count in rays.items() if count >= _CHECKED_RAYS}
