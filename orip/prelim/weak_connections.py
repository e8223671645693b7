"""Parts of a block connected with the rest by one photo and a few points, which alone determine their scale."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Sequence

import numpy as np

from orip.arrays import BoolArray, IntArray
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
    neighbours = _neighbours(np.asarray(common > _FEW, dtype=bool))
    everyone = (1 << len(neighbours)) - 1
    named: set[int] = set()
    for joint in _possible_joints(neighbours):
        parts = list(_parts(neighbours, everyone & ~(1 << joint)))
        largest = max(parts, key=int.bit_count, default=0)
        for part in parts:
            if part == largest or part in named:
                continue
            members = np.array(list(_places(part)), dtype=np.int64)
            shared, points = _shared(rays, members, joint)
            if shared <= _FEW and np.count_nonzero(known_on_ground & points) < 2:
                named.add(part)
                yield _sentence(rays, members, joint, shared)


def _neighbours(together: BoolArray) -> list[int]:
    """Return the neighbours of each photo as the bits of a number: sets of some hundred photos at once."""
    rows = np.packbits(together, axis=1, bitorder="little")
    return [int.from_bytes(row.tobytes(), "little") for row in rows]


def _places(photos: int) -> Iterator[int]:
    """Yield the places of the bits of a number, ascending."""
    while photos:
        last = photos & -photos
        yield last.bit_length() - 1
        photos ^= last


def _possible_joints(neighbours: Sequence[int]) -> list[int]:
    """Return the photos, ascending, through which others are reached: the leaves of a spanning tree connect nothing."""
    joints, unreached = set(), (1 << len(neighbours)) - 1
    while unreached:
        root = (unreached & -unreached).bit_length() - 1
        joints.add(root)
        unreached ^= 1 << root
        waiting = deque([root])
        while waiting:
            photo = waiting.popleft()
            if new := neighbours[photo] & unreached:
                joints.add(photo)
                unreached ^= new
                waiting.extend(_places(new))
    return sorted(joints)


def _parts(neighbours: Sequence[int], photos: int) -> Iterator[int]:
    """Yield the connected parts of photos."""
    while photos:
        part = front = photos & -photos
        photos ^= part
        while front:
            photo = front.bit_length() - 1
            new = neighbours[photo] & photos
            front ^= (1 << photo) | new
            photos ^= new
            part |= new
        yield part


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
