"""Parts of a block connected with the rest by one photo and a few points, which alone determine their scale."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from orip.arrays import BoolArray, IntArray, distinct
from orip.prelim.rays.image_rays import ImageRays
from orip.wording import agreeing, counted, first_names

_FEW = 5
"""Number of common points up to which a wrong one among them cannot be distinguished from a wrong scale."""

_NAMED = 8
"""Number of photos that are named one by one."""


def weak_connections(rays: ImageRays, common: IntArray, known_on_ground: BoolArray) -> Iterator[str]:
    """Yield a sentence for each part of a block whose scale depends on a few points.

    Parameters
    ----------
    rays : ImageRays
    common : array (photos, photos)
        Numbers of common points.
    known_on_ground : array (number of points,) of bool
        Control: a part that sees two of these points has a scale of its own.
    """
    together = common > _FEW
    named: set[frozenset[int]] = set()
    for joint in _possible_joints(together):
        others = np.flatnonzero(np.arange(len(rays.photos)) != joint)
        parts, _ = _connected_parts(together[np.ix_(others, others)])
        largest = max(parts, key=len, default=None)
        for part in parts:
            members = others[part]
            if part is largest or frozenset(members.tolist()) in named:
                continue
            shared, points = _shared(rays, members, joint)
            if shared <= _FEW and np.count_nonzero(known_on_ground & points) < 2:
                named.add(frozenset(members.tolist()))
                yield _sentence(rays, members, joint, shared)


def _possible_joints(together: BoolArray) -> IntArray:
    """Return the photos, ascending, through which others are reached: the leaves of a spanning tree connect nothing."""
    parts, reached_from = _connected_parts(together)
    roots = [part[:1] for part in parts]
    return distinct(np.concatenate([*roots, reached_from[reached_from >= 0]]))


def _connected_parts(together: BoolArray) -> tuple[list[IntArray], IntArray]:
    """Return the members of each connected part, ascending, and from which photo each one was reached, the first -1.

    `together` (photos, photos) says which two are connected. Each part is gone through
    from its first photo, breadth first.
    """
    parts: list[IntArray] = []
    part_of = np.full(len(together), -1)
    reached_from = np.full(len(together), -1)
    while (left := np.flatnonzero(part_of < 0)).size:
        newest = left[:1]
        while newest.size:
            part_of[newest] = len(parts)
            neighbours = together[newest] & (part_of < 0)
            found = np.flatnonzero(neighbours.any(axis=0))
            reached_from[found] = newest[neighbours[:, found].argmax(axis=0)]
            newest = found
        parts.append(np.flatnonzero(part_of == len(parts)))
    return parts, reached_from


def _shared(rays: ImageRays, members: IntArray, joint: int) -> tuple[int, BoolArray]:
    """Return how many points photos share with those outside, the joint excepted, and which points they see."""
    photos = np.zeros(len(rays.photos), dtype=bool)
    photos[members] = True
    inside, outside = np.zeros((2, len(rays.points)), dtype=bool)
    inside[rays.point[photos[rays.photo]]] = True
    photos[joint] = True
    outside[rays.point[~photos[rays.photo]]] = True
    return int(np.count_nonzero(inside & outside)), inside


def _sentence(rays: ImageRays, members: IntArray, joint: int, shared: int) -> str:
    photos = f"{agreeing(len(members), 'photo')} {first_names([rays.photos[photo] for photo in members], _NAMED)}"
    are = agreeing(len(members), "is", "are")
    return (
        f"{photos} {are} connected with the others only by photo {rays.photos[joint]} and {counted(shared, 'point')}, "
        "which alone determine the scale there: measure more common points, or control"
    )
