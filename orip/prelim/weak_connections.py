"""Parts of a block connected with the rest by one photo and a few points, which alone determine their scale."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from orip.arrays import BoolArray, IntArray
from orip.prelim.rays.image_rays import ImageRays
from orip.wording import agreeing, counted, first_names

if TYPE_CHECKING:
    from scipy.sparse import csr_array


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
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import connected_components

    together = csr_array(common > _FEW)
    named: set[frozenset[int]] = set()
    for joint in _possible_joints(together):
        others = np.flatnonzero(np.arange(len(rays.photos)) != joint)
        count, label = connected_components(together[others][:, others], directed=False)
        largest = int(np.bincount(label).argmax()) if count > 1 else 0
        for part in range(count):
            members = others[label == part]
            if part == largest or frozenset(members.tolist()) in named:
                continue
            shared, points = _shared(rays, members, joint)
            if shared <= _FEW and np.count_nonzero(known_on_ground & points) < 2:
                named.add(frozenset(members.tolist()))
                yield _sentence(rays, members, joint, shared)


def _possible_joints(together: csr_array) -> IntArray:
    """Return the photos, ascending, through which others are reached: the leaves of a spanning tree connect nothing."""
    from scipy.sparse.csgraph import breadth_first_order, connected_components

    _, label = connected_components(together, directed=False)
    _, roots = np.unique(label, return_index=True)
    before = [breadth_first_order(together, root, directed=False)[1] for root in roots]
    reached_from = np.unique(np.concatenate([roots, *before]))
    return np.asarray(reached_from[reached_from >= 0], dtype=np.int64)


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
