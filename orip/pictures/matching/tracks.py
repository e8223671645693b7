"""Tracks: features of many photos that are the same point; a selection of them, and the windows around their rays."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from orip.pictures.matching.features import Features, cells

LEAST_OF_PAIR = 12
"""Points that two photos with matches keep in common, if there are as many."""
_ENOUGH = 3
"""Part of the points of a photo to which those of two rays fill it."""


class Tracks(Struct, frozen=True):
    """Rays in the order of their tracks.

    Parameters
    ----------
    track : ndarray (r,)
        From 0 without gaps.
    photo : ndarray (r,)
    feature : ndarray (r,)
        Of the photo.
    """

    track: NDArray[np.intp]
    photo: NDArray[np.intp]
    feature: NDArray[np.intp]

    def __len__(self) -> int:
        return int(self.track[-1]) + 1 if len(self.track) else 0

    def take(self, rays: NDArray[np.bool_] | NDArray[np.intp]) -> Tracks:
        """Return some of the rays; tracks left without any have no number."""
        return Tracks(np.unique(self.track[rays], return_inverse=True)[1], self.photo[rays], self.feature[rays])


def join_tracks(
    features: Sequence[Features], matches: Mapping[tuple[int, int], NDArray[np.intp]]
) -> tuple[Tracks, int]:
    """Return the tracks that matches of pairs of photos join, and how many were dropped.

    A track with two features in a photo is wrong somewhere, and dropped. Features of two directions at one place are
    one.
    """
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    start = np.cumsum([0, *(len(of_photo) for of_photo in features)])
    count = int(start[-1])
    place = np.arange(count)
    for number, of_photo in enumerate(features):
        _, first, same = np.unique(of_photo.place, axis=0, return_index=True, return_inverse=True)
        place[start[number] : start[number + 1]] = start[number] + first[same.ravel()]
    ends = [np.zeros((0, 2), dtype=np.intp)]
    ends += [place[pairs + start[[one, other]]] for (one, other), pairs in sorted(matches.items())]
    one, other = np.concatenate(ends).T
    graph = coo_matrix((np.ones(len(one)), (one, other)), shape=(count, count))
    component = connected_components(graph, directed=False)[1]
    nodes = np.unique(np.concatenate([one, other]))
    photo = np.searchsorted(start, nodes, side="right") - 1
    order = np.lexsort((photo, component[nodes]))
    nodes, photo = nodes[order], photo[order]
    track = np.unique(component[nodes], return_inverse=True)[1]
    twice = (np.diff(track) == 0) & (np.diff(photo) == 0)
    wrong = np.unique(track[1:][twice])
    found = Tracks(track, photo, nodes - start[photo])
    return found.take(~np.isin(track, wrong)), len(wrong)


def parts_of(tracks: Tracks, photos: int) -> NDArray[np.intp]:
    """Return to which part of the block each photo belongs: tracks join the photos of a part."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    nodes = photos + len(tracks)
    graph = coo_matrix((np.ones(len(tracks.track)), (tracks.photo, photos + tracks.track)), shape=(nodes, nodes))
    label = connected_components(graph, directed=False)[1][:photos]
    found: NDArray[np.intp] = np.unique(label, return_inverse=True)[1].astype(np.intp)
    return found


def select_tracks(
    tracks: Tracks,
    place: NDArray[np.float64],
    error: NDArray[np.float64],
    reach: NDArray[np.float64],
    sizes: Sequence[tuple[int, int]],
    most: int,
) -> NDArray[np.intp]:
    """Return the numbers of tracks that cover each photo evenly, with as many rays as possible.

    Tracks with many and precise rays come first. One is taken if in a photo that has not enough its part of the photo
    is empty, or if a pair of photos has too few points in common. Of two rays nothing confirms that they are of the
    same point: such tracks only fill photos that lack others. Patches of one photo do not overlap: what they share of
    its noise would be an error that the adjustment takes for two independent ones.

    Parameters
    ----------
    place : ndarray (r, 2)
        Of the rays, pixels.
    error : ndarray (r,)
        Their expected errors, or what these are proportional to.
    reach : ndarray (r,)
        Of their patches to each side, pixels; 0 where none is matched.
    sizes : sequence of tuple of 2 int
        Columns and rows of the photos.
    most : int
        Points of a photo.
    """
    cell = np.zeros(len(place), dtype=np.intp)
    for photo, size in enumerate(sizes):
        here = tracks.photo == photo
        cell[here] = cells(place[here], size, most)
    rays = np.bincount(tracks.track, minlength=len(tracks))
    first = np.concatenate([[0], np.cumsum(rays)])
    worth = (rays - 1.0) / np.sqrt(np.bincount(tracks.track, weights=error) / np.maximum(rays, 1))
    order = np.argsort(-worth, kind="stable")
    taken: list[int] = []
    patches = _Patches(place, reach, tracks.photo, len(sizes))
    full: set[tuple[int, int]] = set()
    have = [0] * len(sizes)
    pairs: dict[tuple[int, int], int] = {}
    photos, parts = tracks.photo.tolist(), cell.tolist()
    for number in order.tolist():
        span = range(first[number], first[number + 1])
        own = [(photos[ray], parts[ray]) for ray in span]
        enough = most if len(own) > 2 else most // _ENOUGH
        needed = any(have[photo] < enough and (photo, part) not in full for photo, part in own)
        joined = [(a[0], b[0]) for i, a in enumerate(own) for b in own[i + 1 :]] if len(own) <= 8 else []
        if not needed and not any(pairs.get(pair, 0) < LEAST_OF_PAIR for pair in joined):
            continue
        if patches.overlap(span):
            continue
        patches.take(span)
        taken.append(number)
        full.update(own)
        for photo, _ in own:
            have[photo] += 1
        for pair in joined:
            pairs[pair] = pairs.get(pair, 0) + 1
    return np.array(sorted(taken), dtype=np.intp)


class _Patches:
    """The squares that the patches of the tracks taken so far cover in each photo."""

    def __init__(
        self, place: NDArray[np.float64], reach: NDArray[np.float64], photo: NDArray[np.intp], photos: int
    ) -> None:
        self._square = np.column_stack([place, reach])
        self._photo = photo.tolist()
        self._taken = [np.zeros((64, 3)) for _ in range(photos)]
        self._count = [0] * photos

    def overlap(self, rays: range) -> bool:
        """Return whether a patch of these rays overlaps one that is taken."""
        return any(self._overlaps(ray) for ray in rays)

    def _overlaps(self, ray: int) -> bool:
        photo, (x, y, reach) = self._photo[ray], self._square[ray]
        others = self._taken[photo][: self._count[photo]]
        near = others[:, 2] + reach
        return bool(((np.abs(others[:, 0] - x) < near) & (np.abs(others[:, 1] - y) < near)).any())

    def take(self, rays: range) -> None:
        """Add the patches of these rays."""
        for ray in rays:
            photo = self._photo[ray]
            if self._count[photo] == len(self._taken[photo]):
                self._taken[photo] = np.concatenate([self._taken[photo], np.zeros_like(self._taken[photo])])
            self._taken[photo][self._count[photo]] = self._square[ray]
            self._count[photo] += 1


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
