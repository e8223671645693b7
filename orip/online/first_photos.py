"""Whether and when there is enough in some photos for the first ones of a block, or of a part of it, to be oriented."""

from __future__ import annotations

from collections.abc import Collection

from orip.online.measurements import Measurements
from orip.sequential.observation_rows import ObservationKey

COMMON_POINTS = 5
"""Points common to two photos, or control points of one, from which the first photos may be oriented."""

_LATER = 0.1
"""Part by which the measurements have to increase before it is tried again without more control."""

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


class StartAttempts:
    """When it is tried again to orient photos that wait, which takes its time.

    Attributes
    ----------
    changes : int
        How often what is measured, or what of it counts, has changed.
    """

    def __init__(self) -> None:
        self.changes = self._tried_thoroughly = 0
        self._is_control_new = True
        self._next_start = 0
        self._tried: dict[tuple[str, bool], tuple[int, int]] = {}

    def note(self, measurements: Measurements, key: ObservationKey) -> None:
        """Remember that a photo point has changed; what is measured of control decides on what waits."""
        self.changes += 1
        self._is_control_new |= measurements.control.is_about(key.point) or measurements.has_orientation(key.photo)

    def is_due(self, measurements: Measurements) -> bool:
        """Return whether the first photos may be oriented since it was tried: more control, or a tenth more."""
        return self._is_control_new or len(measurements) >= self._next_start

    def started(self, measurements: Measurements) -> None:
        """Remember that it is tried."""
        self._is_control_new = False
        self._next_start = int(len(measurements) * (1.0 + _LATER))

    def is_due_thoroughly(self) -> bool:
        """Return whether anything has changed since this was asked the last time; then the first photos are due."""
        is_due = self._tried_thoroughly != self.changes
        self._tried_thoroughly = self.changes
        self._is_control_new |= is_due
        return is_due

    def may_join(self, measurements: Measurements, oriented: Collection[str], photo: str) -> bool:
        """Return whether photos that are not tied to oriented ones may be oriented together since it was tried.

        Parameters
        ----------
        measurements : Measurements
        oriented : collection of str
        photo : str
            One of them; empty: any, and thoroughly, as soon as anything of theirs has changed.
        """
        seen: set[str] = set()
        for name in [photo] if photo else measurements.photos:
            if name in oriented or name in seen:
                continue
            group = _waiting_group(measurements, name, oriented)
            seen |= group
            keys = [(other, not photo) for other in sorted(group)]
            control, rays = _control_and_rays(measurements, group)
            before = max(self._tried.get(key, (0, 0)) for key in keys)
            is_due = control > before[0] or rays >= before[1] * (1.0 + _LATER) or (not photo and rays != before[1])
            if is_due and _may_be_placed(measurements, group):
                self._tried.update(dict.fromkeys(keys, (control, rays)))
                return True
        return False


def _waiting_group(measurements: Measurements, photo: str, oriented: Collection[str]) -> set[str]:
    """Return the photos that are tied to one by points, over photos that are not oriented either."""
    group, fresh = {photo}, {photo}
    while fresh:
        points = {point for name in fresh for point in measurements.points_in(name)}
        fresh = {name for name in measurements.sharing(points) if name not in oriented} - group
        group |= fresh
    return group


def _may_be_placed(measurements: Measurements, group: Collection[str]) -> bool:
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


def _control_and_rays(measurements: Measurements, group: Collection[str]) -> tuple[int, int]:
    """Return how many photo points of some photos are of control, and how many there are."""
    rays = [point for photo in group for point in measurements.points_in(photo)]
    return sum(map(measurements.control.is_about, rays)), len(rays)
