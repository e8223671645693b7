"""One photo under two names: all points that both photos show are at the same coordinates."""

from __future__ import annotations

import numpy as np

from orip.arrays import IntArray, parts
from orip.errors import ProjectWarning
from orip.records.block import Block, IndexedPhotoPoints

_FEWEST = 5
"""Least number of common points; fewer may have the same coordinates by chance, as in photos taken in one line."""

_ERRORS = 4.0
"""Standard errors of the difference of two measurements within which they are the same."""

_SAME = 1e-3
"""Largest difference, as a part of the extent of all photo points: a camera that moves by a thousandth of the distance
to its points shifts them by more."""


def photos_under_two_names(block: Block) -> list[ProjectWarning]:
    """Return a warning for each pair of photos that show all their common points at the same coordinates."""
    points = block.photo_points
    order = np.argsort(points.point, kind="stable")
    near = _SAME * max(np.ptp(points.xy[:, 0]), np.ptp(points.xy[:, 1])) if len(points.xy) else 0.0
    # nearly always no two photos have so many points at one place, and nothing else need be looked at
    at_one_place = _shared(points, order, near, near)
    photos = np.unique([pair[:2] for pair in _same(at_one_place)])
    shared = _shared(points, order[np.isin(points.photo[order], photos)], near, np.inf)
    return [_warning(block, *pair) for pair in _same(shared)]


def _shared(points: IndexedPhotoPoints, order: IntArray, near: float, reach: float) -> IntArray:
    """Return the photos of two measurements of a point, and whether these are at the same coordinates (k, 3).

    Parameters
    ----------
    points : IndexedPhotoPoints
    order : array of int
        Their rows, point after point.
    near : float
        Largest difference of the same coordinates, mm.
    reach : float
        Those farther apart in x are left out, mm.
    """
    point, x = points.point[order], points.xy[order, 0]
    found = [np.empty((0, 3), dtype=np.int64)]
    for offset in range(1, int(np.bincount(point).max(initial=0))):
        for part in parts(len(order) - offset):
            other = slice(part.start + offset, part.stop + offset)
            is_pair = (point[part] == point[other]) & (np.abs(x[part] - x[other]) <= reach)
            first = part.start + np.flatnonzero(is_pair)
            if len(first):
                found.append(_pairs(points, order[first], order[first + offset], near))
    return np.concatenate(found)


def _pairs(points: IndexedPhotoPoints, one: IntArray, other: IntArray, near: float) -> IntArray:
    """Return what `_shared` does of pairs of rows (k,) of the same points."""
    # a point that is measured twice in a photo is no second photo
    in_two = points.photo[one] != points.photo[other]
    one, other = one[in_two], other[in_two]
    difference = np.abs(points.xy[one] - points.xy[other])
    limit = np.minimum(_ERRORS * np.hypot(points.error[one], points.error[other]), near)
    photos = np.sort(np.column_stack([points.photo[one], points.photo[other]]), axis=1)
    return np.column_stack([photos, (difference <= limit).all(axis=1)])


def _same(shared: IntArray) -> list[tuple[int, int, int]]:
    """Return pairs of photos that have all their common points at the same coordinates, and the number of these."""
    if not len(shared):
        return []
    photos = int(shared[:, 1].max()) + 1
    both, which = np.unique(shared[:, 0] * photos + shared[:, 1], return_inverse=True)
    pairs = np.column_stack(np.divmod(both, photos))
    common = np.bincount(which.ravel(), minlength=len(pairs))
    at_one_place = np.bincount(which.ravel(), weights=shared[:, 2], minlength=len(pairs))
    found = np.flatnonzero((common >= _FEWEST) & (at_one_place >= common))
    return [(int(pairs[row, 0]), int(pairs[row, 1]), int(common[row])) for row in found]


def _warning(block: Block, one: int, other: int, count: int) -> ProjectWarning:
    first, second = block.photos[one].name, block.photos[other].name
    text = (
        f"all {count} points that it shares with photo {first} are at the same place in both: probably one photo that "
        "was measured under two names and counts twice; remove one of them"
    )
    return ProjectWarning("same-photo", f"photo {second}", text)
