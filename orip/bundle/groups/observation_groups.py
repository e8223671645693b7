"""The observations of a block in groups that may be wrong together: by kind, component, camera and kind of element."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping

import numpy as np
from msgspec import Struct

from orip.arrays import BoolArray, IntArray
from orip.bundle.kinds.observation import Observations
from orip.bundle.kinds.photo_point import PhotoPointObservations
from orip.bundle.solve import SolvedBlock
from orip.records.names import record_key
from orip.records.observations.observation_kinds import ATTITUDE, CONTROL_POINT, DIRECTION, DISTANCE, ELEMENT, STATION
from orip.records.project.camera import CAMERA_PARAMETERS
from orip.records.results.group_test import GroupKind

_KINDS: dict[str, GroupKind] = {
    CONTROL_POINT.name: "control",
    ELEMENT.name: "element",
    DISTANCE.name: "distance",
    DIRECTION.name: "direction",
    STATION.name: "station",
    ATTITUDE.name: "attitude",
}
"""Additional parameters and constants that are met exactly were not measured."""


class ObservationGroup(Struct, frozen=True):
    """Observations of one kind and component; see `orip.records.results.group_test.GroupTest`.

    Parameters
    ----------
    kind, of, component
    rows : array (n,) of int
        Among all observation equations.
    names : tuple of str, length n
        Of the points, photos or distances; empty for photo points.
    """

    kind: GroupKind
    of: str
    component: str
    rows: IntArray
    names: tuple[str, ...] = ()


def observation_groups(solved: SolvedBlock, check_points: Collection[str]) -> tuple[ObservationGroup, ...]:
    """Return the groups of a block's observations in use, and of its check points, in the order of the kinds.

    Parameters
    ----------
    solved : SolvedBlock
    check_points : collection of str
        Names of the points whose given coordinates are compared with the adjusted ones.
    """
    groups: list[ObservationGroup] = []
    checks: list[ObservationGroup] = []
    strips = {record_key(station.photo): station.strip for station in solved.block.stations}
    first = 0
    for kind in solved.problem.observations:
        count = len(kind.rows.error)
        active = solved.equations.active[first : first + count]
        if isinstance(kind, PhotoPointObservations):
            groups += _of_photo_points(kind, solved, active, first)
        elif kind.rows.kind.name in _KINDS:
            groups += _of_kind(kind, active, _KINDS[kind.rows.kind.name], first, strips)
            if kind.rows.kind == CONTROL_POINT:
                compared = np.array([name in check_points for name in kind.rows.point], dtype=bool)
                checks += _of_kind(kind, compared & ~kind.rows.used, "check", first, {})
        first += count
    return (*groups, *checks)


def _of_photo_points(
    kind: PhotoPointObservations, solved: SolvedBlock, active: BoolArray, first: int
) -> Iterator[ObservationGroup]:
    for index, camera in enumerate(solved.block.cameras):
        for place, component in enumerate("xy"):
            rows = np.flatnonzero((kind.camera == index) & active[place::2])
            if len(rows):
                rows *= 2
                rows += first + place
                yield ObservationGroup("photo", camera.name, component, rows)


def _of_kind(
    kind: Observations, chosen: BoolArray, group: GroupKind, first: int, strips: Mapping[str, str]
) -> Iterator[ObservationGroup]:
    rows = kind.rows
    members: dict[tuple[str, str], list[int]] = {}
    for row in np.flatnonzero(chosen).tolist():
        of = strips.get(record_key(rows.photo[row]), "") if group in ("station", "attitude") else ""
        if group == "element":
            of = _record_of_element(rows.photo[row], rows.component[row])
        members.setdefault((of, rows.component[row]), []).append(row)
    for (of, component), places in members.items():
        names = tuple(rows.point[row] or rows.photo[row] for row in places)
        yield ObservationGroup(group, of, component, first + np.array(places, dtype=np.int64), names)


def _record_of_element(photo: str, component: str) -> str:
    if photo:
        return "PHOTO"
    if component in ("X", "Y", "Z"):
        return "POINT"
    return "CAMERA" if component in CAMERA_PARAMETERS else "THEODOLITE"
