"""The order of the photos of a refinement that keeps the band of their normal equations narrow."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from orip.arrays import IntArray
from orip.prelim.refinement.problem import RefinementProblem


class BandOrder(NamedTuple):
    """The order of the photos.

    Attributes
    ----------
    order : array (f,)
        Free photos.
    place : array (p,)
        Place of each photo in this order; -1 for a photo that is held.
    places : int
        Largest number of places, both counted, from the first to the last photo of a free point.
    """

    order: IntArray
    place: IntArray
    places: int


def band_order(problem: RefinementProblem) -> BandOrder:
    """Order the free photos of a refinement by the reverse method of Cuthill and McKee (1969; George 1971).

    Photos that see a common free point are neighbours. Each part of the block begins with a photo that has fewest
    neighbours; neighbours follow by their numbers of neighbours, equal ones by their indices.
    """
    neighbours = _neighbours(problem)
    waiting = sorted(np.flatnonzero(problem.photo_free).tolist(), key=lambda photo: len(neighbours[photo]))
    found: dict[int, None] = {}
    for first in waiting:
        level = [first] if first not in found else []
        while level:
            found.update(dict.fromkeys(level))
            following: dict[int, None] = {}
            for photo in level:
                unfound = (other for other in neighbours[photo] if other not in found)
                following.update(dict.fromkeys(sorted(unfound, key=lambda other: (len(neighbours[other]), other))))
            level = list(following)
    order = np.array([*found][::-1], dtype=np.int64)
    place = np.full(len(problem.photo_free), -1)
    place[order] = np.arange(len(order))
    return BandOrder(order, place, _places(problem, place))


def _neighbours(problem: RefinementProblem) -> list[list[int]]:
    """Return for each photo the other free ones that see a free point that it sees, ascending; none of a held photo."""
    from scipy.sparse import csr_array

    rays = problem.rays
    taking = problem.photo_free[rays.photo] & problem.point_free[rays.point]
    shape = (len(problem.point_free), len(problem.photo_free))
    sees = csr_array((np.ones(np.count_nonzero(taking)), (rays.point[taking], rays.photo[taking])), shape=shape)
    photo, other = (sees.T @ sees).nonzero()
    pairs = sorted(zip(photo.tolist(), other.tolist(), strict=True))
    neighbours: list[list[int]] = [[] for _ in problem.photo_free]
    for one, two in pairs:
        if one != two:
            neighbours[one].append(two)
    return neighbours


def _places(problem: RefinementProblem, place: IntArray) -> int:
    of_rays, point = place[problem.rays.photo], problem.rays.point
    taking = (of_rays >= 0) & problem.point_free[point]
    first = np.full(len(problem.point_free), len(place) + 1)
    last = np.full(len(first), -1)
    np.minimum.at(first, point[taking], of_rays[taking])
    np.maximum.at(last, point[taking], of_rays[taking])
    return int((last - first).max(initial=-1, where=last >= 0)) + 1
