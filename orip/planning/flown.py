"""What was flown of a plan: exposures that are missing, gaps in the overlap, and what to fly again."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from itertools import pairwise

import numpy as np
from msgspec import Struct

from orip.arrays import FloatArray, IntArray
from orip.geometry.rotation import rotation_from_angles
from orip.records.control import Station
from orip.structs import replace

_NEAR = 0.5
"""Part of the least base of a strip within which a planned exposure was made."""

_BORDER = 0.05
"""Part of the frame at each side that no planned overlap is counted with: flights are not exact."""


class Flown(Struct, frozen=True):
    """A plan beside its flight.

    Parameters
    ----------
    again : tuple of Station
        Planned exposures that were not made.
    strips : tuple of str
        Strips of which none was made.
    flown : tuple of Station
        What was made, with planned angles where the log has none.
    nodes : array (n, 3)
        Of the ground.
    planned, found, closed : arrays (n,) of int
        Photos that show each node: planned (at least, and counted up to what is wanted), flown, and with those that are
        to be flown again.
    off : array (m,)
        Distances of what was made from its plan, ground unit.
    """

    again: tuple[Station, ...]
    strips: tuple[str, ...]
    flown: tuple[Station, ...]
    nodes: FloatArray
    planned: IntArray
    found: IntArray
    closed: IntArray
    off: FloatArray

    @property
    def gaps(self) -> IntArray:
        """Return the nodes that fewer photos show than were wanted."""
        return np.flatnonzero(self.found < self.planned)

    @property
    def open_gaps(self) -> IntArray:
        """Return those that stay when what is missing is flown again."""
        return np.flatnonzero(self.closed < self.planned)


def compare_flight(
    planned: Sequence[Station], log: Sequence[Station], frame: FloatArray, c: float, nodes: FloatArray, wanted: int
) -> Flown:
    """Return what was flown of a plan.

    Parameters
    ----------
    log : sequence of Station
        As flown, in the project; those without a position are left out.
    frame : array (2,)
        Of the photo, mm.
    nodes : array (n, 3)
        Of the ground, at which overlaps are counted.
    wanted : int
        Photos that are to show a node, where the plan has as many.
    """
    flown, pairs = _paired(planned, log)
    again = tuple(one for row, one in enumerate(planned) if row not in pairs)
    in_strips = Counter(station.strip for station in planned)
    missing = Counter(station.strip for station in again)
    asked = np.minimum(counted(planned, frame * (1.0 - 2.0 * _BORDER), c, nodes), wanted)
    found = counted(flown, frame, c, nodes)
    return Flown(
        again,
        tuple(strip for strip, count in in_strips.items() if missing[strip] == count),
        flown,
        nodes,
        asked,
        found,
        found + counted(again, frame, c, nodes),
        np.array([math.dist(planned[row].position, flown[log_row].position) for row, log_row in pairs.items()]),
    )


def as_flown(planned: Sequence[Station], log: Sequence[Station]) -> tuple[Station, ...]:
    """Return the stations of a log, with planned angles where it has none; those without a position are left out."""
    return _paired(planned, log)[0]


def _paired(planned: Sequence[Station], log: Sequence[Station]) -> tuple[tuple[Station, ...], dict[int, int]]:
    """Return the stations of a log with angles, and which of them was which of the plan."""
    there = [station for station in log if station.has_position]
    places = np.array([station.position for station in planned])
    made = np.array([station.position for station in there]).reshape(-1, 3)
    pairs = _matched(places, made, _NEAR * _least_base(planned, places))
    return _with_angles(there, made, planned, places, {log_row: row for row, log_row in pairs.items()}), pairs


def _least_base(planned: Sequence[Station], places: FloatArray) -> float:
    """Return the least distance from photo to photo in a strip; of single photos there is none to compare with."""
    steps = np.linalg.norm(np.diff(places, axis=0), axis=1)
    same = np.array([one.strip == other.strip for one, other in pairwise(planned)], dtype=bool)
    return float(steps[same & (steps > 0.0)].min(initial=np.inf))


def _matched(places: FloatArray, made: FloatArray, limit: float) -> dict[int, int]:
    """Return which photo of the log was which of the plan: the nearest pairs first, each photo once."""
    from scipy.spatial import KDTree

    if not len(made):
        return {}
    # distances of photos that are alone in their strip are not limited, but finite
    most = min(limit, 1e9)
    near = KDTree(places).sparse_distance_matrix(KDTree(made), most, output_type="ndarray")
    found: dict[int, int] = {}
    taken: set[int] = set()
    for one in near[np.argsort(near["v"], kind="stable")].tolist():
        if one[0] not in found and one[1] not in taken:
            found[one[0]] = one[1]
            taken.add(one[1])
    return found


def _with_angles(
    log: Sequence[Station],
    made: FloatArray,
    planned: Sequence[Station],
    places: FloatArray,
    plan_of: Mapping[int, int],
) -> tuple[Station, ...]:
    """Return the photos of a log, with the angles of their plan, or of the nearest planned photo, where it has none."""
    from scipy.spatial import KDTree

    nearest = KDTree(places).query(made)[1].tolist() if len(made) else []
    rows = [plan_of.get(row, near) for row, near in enumerate(nearest)]
    return tuple(
        one if one.has_angles else replace(one, angles=planned[row].angles, angle_error=planned[row].angle_error)
        for one, row in zip(log, rows, strict=True)
    )


def counted(stations: Sequence[Station], frame: FloatArray, c: float, nodes: FloatArray) -> IntArray:
    """Return how many photos (n,) show each node (n, 3)."""
    count = np.zeros(len(nodes), dtype=np.int64)
    for station in stations:
        rotation = rotation_from_angles(np.array([station.angles]))[0]
        u = (nodes - station.position) @ rotation
        in_front = u[:, 2] < 0.0
        xy = -c * u[:, :2] / np.where(in_front, u[:, 2], -np.inf)[:, None]
        count += in_front & (np.abs(xy) <= 0.5 * frame).all(axis=1)
    return count
