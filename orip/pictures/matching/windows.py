"""Windows of photos around the rays of tracks, from which they are matched."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from orip.pictures.matching.features import Features
from orip.pictures.matching.tracks import Tracks

LEVELS = 4
"""Of the pyramid of a photo, each half as large as the one before."""
PLACES_APART = 0.42
"""Of the places of a patch, in the feature's size: it reaches four times as far as the feature."""
HALF = 36
"""Pixels of a window on each side of its middle."""
MARGIN = 24
"""Pixels from the edge of a photo within which no point is matched."""
MOST_RATIO = 2.0
"""Of the scales of two photos of a point: the coarser one lacks what the finer one shows."""


class Approximations(Struct, frozen=True):
    """Rays with what their features say of their patches.

    Parameters
    ----------
    tracks : Tracks
        In the order of the sizes of their features, so that neighbours have the same noise. The ray of median scale is
        the first of each; without those whose scale is too far from it.
    affine : ndarray (r, 2, 2)
        From the patch to pixels: its places are as far apart as the size of the feature in the first photo says.
    level : ndarray (r,)
        In which picture of the pyramid, reduced by 2 ** level, they are one to two pixels apart.
    """

    tracks: Tracks
    affine: NDArray[np.float64]
    level: NDArray[np.intp]


def approximate(tracks: Tracks, features: Sequence[Features]) -> Approximations:
    """Return the approximations of rays."""
    scale = of_rays(tracks, [photo.scale for photo in features])
    order = np.lexsort((tracks.photo, scale, tracks.track))
    count = np.bincount(tracks.track)
    first = np.concatenate([[0], np.cumsum(count)[:-1]])
    rank = np.arange(len(order)) - np.repeat(first, count)
    rank = np.where(rank == np.repeat(count // 2, count), -1, rank)
    order = order[np.lexsort((rank, tracks.track[order]))]
    by_size = np.argsort(scale[order[first]], kind="stable")
    order = order[np.concatenate([np.arange(first[number], first[number] + count[number]) for number in by_size])]
    leader = np.repeat(order[np.concatenate([[0], np.cumsum(count[by_size])[:-1]])], count[by_size])
    rank_of_track = np.argsort(by_size)
    ratio = scale[order] / scale[leader]
    is_near = (ratio <= MOST_RATIO) & (ratio >= 1.0 / MOST_RATIO)
    order, leader = order[is_near], leader[is_near]
    angle = of_rays(tracks, [photo.angle for photo in features])
    turn, zoom = angle[order] - angle[leader], scale[order] / scale[leader]
    step = np.maximum(PLACES_APART * scale[leader], 1.0) * zoom
    c, s = step * np.cos(turn), step * np.sin(turn)
    affine = np.stack([np.stack([c, -s], axis=1), np.stack([s, c], axis=1)], axis=1)
    level = np.clip(np.floor(np.log2(step)), 0, LEVELS - 1).astype(np.intp)
    sorted_tracks = Tracks(rank_of_track[tracks.track], tracks.photo, tracks.feature)
    return Approximations(sorted_tracks.take(order), affine, level)


def patch_reaches(scale: NDArray[np.float64], half: int) -> NDArray[np.float64]:
    """Return how far the patches of features reach to each side, pixels.

    Parameters
    ----------
    scale : ndarray (r,)
        Of the features.
    half : int
        Places of a patch to each side.
    """
    return half * np.maximum(PLACES_APART * scale, 1.0)


def of_rays(tracks: Tracks, values: Sequence[NDArray[np.float64]]) -> NDArray[np.float64]:
    """Return the values of the rays' features, from those of each photo."""
    found = np.zeros((len(tracks.track), *values[0].shape[1:]))
    for photo, own in enumerate(values):
        here = tracks.photo == photo
        found[here] = own[tracks.feature[here]]
    return found


def is_inside(tracks: Tracks, place: NDArray[np.float64], sizes: Sequence[tuple[int, int]]) -> NDArray[np.bool_]:
    """Return which rays are not too near to the edges of their photos."""
    size = np.array(sizes, dtype=float)[tracks.photo]
    return np.asarray(((place >= MARGIN) & (place <= size - MARGIN)).all(axis=1), dtype=np.bool_)


def cut_windows(grey: NDArray[np.uint8], place: NDArray[np.float64]) -> NDArray[np.uint8]:
    """Return windows of a picture; beyond its edges the outermost pixels go on.

    Parameters
    ----------
    grey : ndarray (rows, columns)
    place : ndarray (n, 2)

    Returns
    -------
    ndarray (n, 2 HALF + 1, 2 HALF + 1)
    """
    reach = np.arange(-HALF, HALF + 1)
    middle = np.floor(place).astype(np.intp)
    columns = np.clip(middle[:, :1] + reach, 0, grey.shape[1] - 1)
    rows = np.clip(middle[:, 1:] + reach, 0, grey.shape[0] - 1)
    found: NDArray[np.uint8] = grey[rows[:, :, None], columns[:, None, :]]
    return found


def halved(grey: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return a picture of half the size, means of four pixels; an odd last row or column is left out."""
    rows, columns = grey.shape[0] // 2 * 2, grey.shape[1] // 2 * 2
    even = grey[:rows, :columns].astype(np.uint16)
    total = even[::2, ::2] + even[1::2, ::2] + even[::2, 1::2] + even[1::2, 1::2]
    found: NDArray[np.uint8] = ((total + 2) // 4).astype(np.uint8)
    return found


def in_window(place: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return where places are in their windows, from the centre of the first pixel."""
    return place - np.floor(place) - 0.5 + HALF
