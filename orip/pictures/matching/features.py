"""Features of photos (SIFT), and which of them are the same in two photos.

Lowe, D. (2004): Distinctive image features from scale-invariant keypoints, IJCV 60(2); square roots of descriptors:
Arandjelovic, R. and Zisserman, A. (2012), CVPR; few large features first: Wu, C. (2013): Towards linear-time
incremental structure from motion, 3DV.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

DETAIL = 1600
"""Pixels of the longer side of the picture in which features are found; their places are refined by matching."""

_CONTRAST = 0.02
_CELLS = 6
_NORM = 512.0
_RATIO = 0.8
"""Of the angle to the nearest descriptor and that to the second nearest."""
_WIDEST = 0.7
"""Radians between descriptors of the same place."""
_LARGEST = 500
_PIECE = 1024


class Features(Struct, frozen=True):
    """Features of a photo, the largest first.

    Parameters
    ----------
    place : ndarray (n, 2)
        Column and row from the outer corner of the first pixel stored.
    scale : ndarray (n,)
        Standard deviation of the Gaussian in which the feature was found, pixels stored.
    angle : ndarray (n,)
        From the columns' direction towards that of the rows, radians.
    descriptor : ndarray (n, 128)
    """

    place: NDArray[np.float64]
    scale: NDArray[np.float64]
    angle: NDArray[np.float64]
    descriptor: NDArray[np.uint8]

    def __len__(self) -> int:
        return len(self.place)


def find_features(grey: NDArray[np.uint8], size: tuple[int, int], most: int) -> Features:
    """Return features of a picture, spread over it.

    Parameters
    ----------
    grey : ndarray (rows, columns)
        The picture, perhaps reduced.
    size : tuple of 2 int
        Columns and rows of the photo stored.
    """
    import cv2

    reduced = _reduced(grey)
    sift = cv2.SIFT_create(0, 3, _CONTRAST, 10.0, 1.6, True)  # type: ignore[attr-defined]
    found: list[Any] = list(sift.detect(reduced, None))
    if not found:
        return Features(np.zeros((0, 2)), np.zeros(0), np.zeros(0), np.zeros((0, 128), dtype=np.uint8))
    place = np.array([key.pt for key in found])
    response = np.array([key.response for key in found])
    chosen = spread(place, response, reduced.shape[::-1], most)
    keys, descriptors = sift.compute(reduced, [found[number] for number in chosen])
    zoom = np.array(size, dtype=float) / np.array(reduced.shape[::-1], dtype=float)
    place = (np.array([key.pt for key in keys]) + 0.5) * zoom
    scale = np.array([key.size for key in keys]) / 2.0 * float(np.sqrt(zoom.prod()))
    angle = np.radians([key.angle for key in keys])
    order = np.lexsort((place[:, 0], place[:, 1], -scale))
    return Features(place[order], scale[order], angle[order], _roots(np.asarray(descriptors))[order])


def _reduced(grey: NDArray[np.uint8]) -> NDArray[np.uint8]:
    import cv2

    factor = DETAIL / max(grey.shape)
    if factor >= 1.0:
        return np.ascontiguousarray(grey)
    size = (max(1, round(grey.shape[1] * factor)), max(1, round(grey.shape[0] * factor)))
    return np.asarray(cv2.resize(grey, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)


def spread(
    place: NDArray[np.float64], response: NDArray[np.float64], size: tuple[int, ...], most: int
) -> NDArray[np.intp]:
    """Return the strongest features of each part of a picture: first those that are first in their parts.

    Parameters
    ----------
    place : ndarray (n, 2)
    response : ndarray (n,)
    size : tuple of 2 int
        Columns and rows.
    """
    cell = cells(place, size, _CELLS * _CELLS)
    by_strength = np.lexsort((place[:, 0], place[:, 1], -response, cell))
    sorted_cells = cell[by_strength]
    first = np.flatnonzero(np.diff(sorted_cells, prepend=-1))
    rank = np.arange(len(cell)) - np.repeat(first, np.diff(np.append(first, len(cell))))
    order = np.lexsort((by_strength, -response[by_strength], rank))
    return by_strength[order[:most]]


def cells(place: NDArray[np.float64], size: tuple[int, ...], count: int) -> NDArray[np.intp]:
    """Return in which of about `count` nearly square parts of a picture places are."""
    columns, rows = float(size[0]), float(size[1])
    across = max(1, round(np.sqrt(count * columns / rows)))
    down = max(1, round(count / across))
    column = np.clip((place[:, 0] * across / columns).astype(np.intp), 0, across - 1)
    row = np.clip((place[:, 1] * down / rows).astype(np.intp), 0, down - 1)
    found: NDArray[np.intp] = row * across + column
    return found


def _roots(descriptors: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Return the square roots of descriptors, whose products are sums of whole numbers.

    They are below 2^24: single precision is exact, in whatever order they are added.
    """
    total = np.maximum(descriptors.sum(axis=1, keepdims=True), 1e-9)
    found: NDArray[np.uint8] = np.minimum(np.rint(_NORM * np.sqrt(descriptors / total)), 255.0).astype(np.uint8)
    return found


def match_features(one: Features, other: Features) -> NDArray[np.intp]:
    """Return pairs of features, each the nearest of the other and much nearer than the second nearest, (n, 2)."""
    return _nearest_pairs(one.descriptor, other.descriptor)


def count_large_matches(one: Features, other: Features) -> int:
    """Return how many of the largest features match: a quick sign of whether two photos show the same."""
    return len(_nearest_pairs(one.descriptor[:_LARGEST], other.descriptor[:_LARGEST]))


def _nearest_pairs(one: NDArray[np.uint8], other: NDArray[np.uint8]) -> NDArray[np.intp]:
    if len(one) < 2 or len(other) < 2:
        return np.zeros((0, 2), dtype=np.intp)
    there = other.astype(np.float32).T
    size = np.sqrt((there * there).sum(axis=0))
    nearest = np.empty(len(one), dtype=np.intp)
    is_clear = np.empty(len(one), dtype=bool)
    best_here, best_cosine = np.zeros(len(other), dtype=np.intp), np.full(len(other), -1.0, dtype=np.float32)
    for start in range(0, len(one), _PIECE):
        here = one[start : start + _PIECE].astype(np.float32)
        cosine = here @ there
        cosine /= size
        cosine /= np.sqrt((here * here).sum(axis=1, keepdims=True))
        rows = np.arange(len(here))
        top = cosine.max(axis=0)
        better = top > best_cosine
        best_here[better] = start + cosine.argmax(axis=0)[better]
        best_cosine[better] = top[better]
        found = cosine.argmax(axis=1)
        first = np.arccos(np.minimum(cosine[rows, found], 1.0))
        cosine[rows, found] = -1.0
        second = np.arccos(np.minimum(cosine.max(axis=1), 1.0))
        nearest[start : start + len(here)] = found
        is_clear[start : start + len(here)] = (first < _RATIO * second) & (first < _WIDEST)
    mutual = is_clear & (best_here[nearest] == np.arange(len(one)))
    chosen = np.flatnonzero(mutual)
    return np.column_stack([chosen, nearest[chosen]])
