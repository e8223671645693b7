"""Whether there is enough in some photos for the first ones of a block, or of a part of it, to be oriented."""

from __future__ import annotations

from collections.abc import Collection

from orip.online.measurements import Measurements

COMMON_POINTS = 5
"""Points common to two photos, or control points of one, from which the first photos may be oriented."""

_CARRYING = 3
"""Known points from which a model is placed on the ground."""


def may_start(measurements: Measurements, photo: str) -> bool:
    """Return whether a photo may be oriented by points in common with another one, or by known points."""
    mine = set(measurements.points_in(photo))
    common = (len(mine.intersection(measurements.points_in(other))) for other in measurements.sharing(mine) - {photo})
    if (
        max(common, default=0) >= COMMON_POINTS
        or sum(map(measurements.control.has_coordinates, mine)) >= COMMON_POINTS - 1
    ):
        return True
    return measurements.has_orientation(photo)


def waiting_group(measurements: Measurements, photo: str, oriented: Collection[str]) -> set[str]:
    """Return the photos that are tied to one by points, over photos that are not oriented either."""
    group, fresh = {photo}, {photo}
    while fresh:
        points = {point for name in fresh for point in measurements.points_in(name)}
        fresh = {name for name in measurements.sharing(points) if name not in oriented} - group
        group |= fresh
    return group


def may_join(measurements: Measurements, group: Collection[str]) -> bool:
    """Return whether photos that wait may be oriented together: a model of two, and known points to place it by."""
    rays = {photo: set(measurements.points_in(photo)) for photo in group}
    known = {point for points in rays.values() for point in points if measurements.control.has_coordinates(point)}
    if len(known) < _CARRYING:
        return False
    return any(
        len(mine.intersection(rays[other])) >= COMMON_POINTS
        for photo, mine in rays.items()
        for other in measurements.sharing(mine).intersection(group) - {photo}
    )


def control_and_rays(measurements: Measurements, group: Collection[str]) -> tuple[int, int]:
    """Return how many photo points of some photos are of control, and how many there are."""
    rays = [point for photo in group for point in measurements.points_in(photo)]
    return sum(map(measurements.control.is_about, rays)), len(rays)
