"""Points that are eliminated together, since nearly the same photos show them.

The normal equations of a group are formed in a small matrix of the group's own unknowns, which is then added to the
reduced system. Points of the same photos share it without any loss. Where a point is seen by many photos no two of them
have quite the same ones: then neighbours share the matrix of all their photos.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from orip.arrays import FloatArray, IntArray

_OF_A_GROUP = 8.0
"""Time of clearing an element of a group's matrix and adding it to the reduced system, over that of eliminating a point
from it."""


def sets_of_photos(photo: NDArray[np.int32], start: IntArray) -> tuple[IntArray, list[frozenset[int]]]:
    """Return the number of each point's set of photos, and the sets.

    Parameters
    ----------
    photo : array (k,) of int
        Photos of the rays, ascending for each point.
    start : array (b + 1,) of int
        Where the rays of each point begin.
    """
    numbers: dict[bytes, int] = {}
    rays = [photo[first:last].tobytes() for first, last in pairwise(start.tolist())]
    of_point = np.array([numbers.setdefault(shown, len(numbers)) for shown in rays], dtype=np.int64)
    return of_point, [frozenset(np.frombuffer(shown, dtype=np.int32).tolist()) for shown in numbers]


def groups_of_sets(of_point: IntArray, sets: Sequence[frozenset[int]], coordinates: FloatArray) -> IntArray:
    """Return the number of each set's group; neighbouring sets are joined where that saves time.

    Parameters
    ----------
    of_point : array (b,) of int
        Set of each point.
    sets : sequence of sets of int
    coordinates : array (b, 3)
        Of the points, roughly; they decide about the time alone.
    """
    if not len(sets):
        return np.empty(0, dtype=np.int64)
    _, first, points = np.unique(of_point, return_index=True, return_counts=True)
    from scipy.spatial import KDTree  # takes its time to import

    # halves of halves of its order are neighbours
    order = KDTree(np.nan_to_num(coordinates[first]), leafsize=1).indices.tolist()
    groups = _joined([_Group(sets[number], int(points[number]) * len(sets[number]), (number,)) for number in order])
    of_set = np.empty(len(sets), dtype=np.int64)
    for number, group in enumerate(groups):
        of_set[list(group.sets)] = number
    return of_set


class _Group(Struct, frozen=True):
    """Sets of photos by their numbers, all photos of them, and the number of rays to their points."""

    photos: frozenset[int]
    rays: int
    sets: tuple[int, ...]

    @property
    def time(self) -> float:
        """Return the time that the group takes, of which every ray updates columns of all photos."""
        return len(self.photos) * (_OF_A_GROUP * len(self.photos) + self.rays)


def _joined(groups: Sequence[_Group]) -> list[_Group]:
    """Return fewer groups, joined by halves as long as that saves time."""
    if len(groups) == 1:
        return list(groups)
    middle = len(groups) // 2
    found = _joined(groups[:middle]) + _joined(groups[middle:])
    if len(found) > 2:
        return found
    one, other = found
    both = _Group(one.photos | other.photos, one.rays + other.rays, one.sets + other.sets)
    return [both] if both.time <= one.time + other.time else found
