"""Points that are eliminated together, since nearly the same photos show them.

The normal equations of a group are formed in a small matrix of the group's own unknowns, which is then added to the
reduced system. Points of the same photos share it without any loss. Where a point is seen by many photos no two of them
have quite the same ones: then neighbours share the matrix of all their photos.
"""

from __future__ import annotations

from itertools import count
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from orip.arrays import BoolArray, FloatArray, IntArray, distinct

_OF_A_GROUP = 8.0
"""Time of clearing an element of a group's matrix and adding it to the reduced system, over that of eliminating a point
from it."""


class PhotoSets(NamedTuple):
    """The s different sets of photos that show b points, numbered in the order of their first points.

    Attributes
    ----------
    of_point : array (b,) of int
        Set of each point.
    first : array (s,) of int
        First point of each set.
    number, photo : arrays (r,) of int
        The pairs of a set and a photo in it, ascending.
    """

    of_point: IntArray
    first: IntArray
    number: IntArray
    photo: IntArray


def sets_of_photos(photo: NDArray[np.int32], start: IntArray) -> PhotoSets:
    """Return the sets of photos that show points.

    Parameters
    ----------
    photo : array (k,) of int
        Photos of the rays, ascending for each point.
    start : array (b + 1,) of int
        Where the rays of each point begin.
    """
    rays = np.diff(start)
    for attempt in count(1):
        sums = np.append(np.uint64(0), np.cumsum(_mixed(photo.astype(np.uint64), attempt)))
        _, first, of_point = np.unique(sums[start[1:]] - sums[start[:-1]], return_index=True, return_inverse=True)
        like = first[of_point]
        shift = np.repeat(start[:-1][like] - start[:-1], rays)
        if (rays == rays[like]).all() and np.array_equal(photo, photo[shift + np.arange(len(photo))]):
            break  # nearly always: two sets have the same sum once in 10^19 pairs
    order = np.argsort(first)
    place = np.empty_like(order)
    place[order] = np.arange(len(order))
    first = first[order]
    number = np.repeat(np.arange(len(first)), rays[first])
    of_set = np.repeat(start[:-1][first] - np.cumsum(rays[first]) + rays[first], rays[first]) + np.arange(len(number))
    every = int(photo.max(initial=0)) + 1
    return PhotoSets(place[of_point], first, *np.divmod(distinct(number * every + photo[of_set]), every))


def _mixed(number: NDArray[np.uint64], attempt: int) -> NDArray[np.uint64]:
    """Return numbers that look random, equal ones for equal ones (the finaliser of SplitMix64, Steele et al. 2014)."""
    mixed = (number + np.uint64(1)) * np.uint64(2 * attempt + 0x9E3779B97F4A7C13)
    mixed = (mixed ^ (mixed >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    mixed = (mixed ^ (mixed >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return mixed ^ (mixed >> np.uint64(31))


def groups_of_sets(sets: PhotoSets, coordinates: FloatArray) -> IntArray:
    """Return the number of each set's group; neighbouring sets are joined where that saves time.

    Parameters
    ----------
    sets : PhotoSets
    coordinates : array (b, 3)
        Of the points, roughly; they decide about the time alone.
    """
    size = len(sets.first)
    if not size:
        return np.empty(0, dtype=np.int64)
    order = _order_of_neighbours(np.nan_to_num(coordinates[sets.first]))
    place = np.empty(size, dtype=np.int64)
    place[order] = np.arange(size)
    points = np.bincount(sets.of_point, minlength=size)[order]
    return np.asarray(np.cumsum(_begins_group(place[sets.number], sets.photo, points))[place] - 1)


def _order_of_neighbours(positions: FloatArray) -> IntArray:
    """Return an order of positions (s, 3) of which the halves, the halves of these and so on are neighbours.

    Each is halved across its longest side, as by a k-d tree (Bentley 1975); all of the same length at once.
    """
    size = len(positions)
    rank = np.empty((size, 3), dtype=np.int64)
    np.put_along_axis(rank, np.argsort(positions, axis=0, kind="stable"), np.arange(size)[:, None], axis=0)
    order = np.arange(size)
    for first, _ in _halves(size)[:-1]:  # of two it does not matter which comes first
        placed = positions[order]
        longest = np.argmax(np.maximum.reduceat(placed, first) - np.minimum.reduceat(placed, first), axis=1)
        part = np.repeat(np.arange(len(first)), np.diff(first, append=size))
        order = order[np.argsort(part * size + rank[order, longest[part]])]
    return order


def _begins_group(place: IntArray, photo: IntArray, points: IntArray) -> BoolArray:
    """Return which of s sets in a row begin a group (s,), when neighbours are joined by halves while that saves time.

    Parameters
    ----------
    place, photo : arrays (r,) of int
        The pairs of a set, by its place in the row, and a photo in it.
    points : array (s,) of int
        How many points each set has.
    """
    size, every = len(points), int(photo.max(initial=0)) + 1
    photos = np.bincount(place, minlength=size)
    rays = points * photos
    begins = np.ones(size, dtype=bool)
    # of groups by the place where they begin; of those that may still be joined, the pairs with their photos
    pairs = distinct(place * every + photo)
    for first, middle in reversed(_halves(size)):
        both = _joined(pairs, every, first, middle, size)
        joined_photos = np.bincount(both // every, minlength=size)[first]
        apart = _time(photos[first], rays[first]) + _time(photos[middle], rays[middle])
        whole = (photos[first] > 0) & (photos[middle] > 0)
        saves = whole & (_time(joined_photos, rays[first] + rays[middle]) <= apart)
        begins[middle[saves]] = False
        photos[first] = np.where(saves, joined_photos, 0)
        photos[middle] = 0
        rays[first] += rays[middle]
        pairs = both[photos[both // every] > 0]
    return begins


def _time(photos: IntArray, rays: IntArray) -> FloatArray:
    """Return the time that a group takes, of which every ray updates columns of all photos."""
    return photos * (_OF_A_GROUP * photos + rays)


def _joined(pairs: IntArray, every: int, first: IntArray, middle: IntArray, size: int) -> IntArray:
    """Return the pairs of a group and a photo once the groups that begin in a middle are part of the one before."""
    begin = np.arange(size)
    begin[middle] = first
    group, photo = np.divmod(pairs, every)
    return distinct(begin[group] * every + photo)


def _halves(size: int) -> list[tuple[IntArray, IntArray]]:
    """Return where parts of a row begin and their middles, of the whole, of its halves, and so on down to two."""
    found = []
    ends = np.array([0, size])
    while (length := np.diff(ends)).max() > 1:
        divided = length > 1
        first = ends[:-1][divided]
        middle = first + length[divided] // 2
        found.append((first, middle))
        ends = np.sort(np.concatenate([ends, middle]))
    return found
