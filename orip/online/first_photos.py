"""Whether there is enough in a photo for the first ones to be oriented."""

from __future__ import annotations

from orip.online.measurements import Measurements

COMMON_POINTS = 5
"""Points common to two photos, or control points of one, from which the first photos may be oriented."""


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
