"""Which pairs of photos are compared: those that probably show the same, and what of their matches geometry confirms.

Jegou, H., Douze, M., Schmid, C., Perez, P. (2010): Aggregating local descriptors into a compact image representation
(VLAD), CVPR; each word by itself of unit length: Arandjelovic, R. and Zisserman, A. (2013): All about VLAD, CVPR. The
words are means of the photos' own descriptors.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from orip.pictures.matching.features import Features, count_large_matches
from orip.progress import stage
from orip.threads import by_threads

_WORDS = 64
_OF_PHOTO = 1000
"""Features of a photo, the largest, that its vector is made of."""
_SAMPLE = 30_000
"""Descriptors of all photos together that words are the means of."""
_ROUNDS = 10
_SEED_OF_WORDS = 1
_PIECE = 256


def likely_pairs(features: Sequence[Features], most: int) -> list[tuple[int, int]]:
    """Return pairs of photos of which one is among the most similar ones of the other, sorted.

    Parameters
    ----------
    most : int
        Photos that each is paired with, at least.
    """
    words = visual_words(features)
    vectors = np.array([photo_vector(photo, words) for photo in features], dtype=np.float32)
    chosen = np.zeros((len(features), len(features)), dtype=bool)
    for start in range(0, len(features), _PIECE):
        similarity = vectors[start : start + _PIECE] @ vectors.T
        rows = np.arange(len(similarity))[:, None]
        similarity[rows[:, 0], start + rows[:, 0]] = -np.inf
        chosen[start + rows, np.argsort(-similarity, axis=1, kind="stable")[:, :most]] = True
    chosen |= chosen.T
    np.fill_diagonal(chosen, val=False)
    one, other = np.nonzero(np.triu(chosen))
    return list(zip(one.tolist(), other.tolist(), strict=True))


def visual_words(features: Sequence[Features]) -> NDArray[np.float32]:
    """Return mean descriptors of clusters (k-means), (64, 128) or as many as there are descriptors."""
    share = max(1, _SAMPLE // max(len(features), 1))
    descriptors = np.concatenate([photo.descriptor[:share] for photo in features]).astype(np.float32)
    if not len(descriptors):
        return np.zeros((1, descriptors.shape[1]), dtype=np.float32)
    count = min(_WORDS, len(descriptors))
    begin = np.random.default_rng(_SEED_OF_WORDS).choice(len(descriptors), count, replace=False)
    words = descriptors[np.sort(begin)]
    for _ in range(_ROUNDS):
        nearest = _nearest(descriptors, words)
        members = np.bincount(nearest, minlength=count)
        total = np.zeros_like(words)
        np.add.at(total, nearest, descriptors)
        words = np.where(members[:, None] > 0, total / np.maximum(members, 1)[:, None], words).astype(np.float32)
    return words


def photo_vector(features: Features, words: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the vector of a photo: by how much its descriptors differ from their words; of unit length, or zero."""
    descriptors = features.descriptor[:_OF_PHOTO].astype(np.float32)
    total = np.zeros_like(words)
    if len(descriptors):
        nearest = _nearest(descriptors, words)
        np.add.at(total, nearest, descriptors - words[nearest])
    total /= np.maximum(np.linalg.norm(total, axis=1, keepdims=True), np.float32(1e-9))
    vector = total.ravel()
    return np.asarray(vector / max(float(np.linalg.norm(vector)), 1e-9), dtype=np.float32)


def _nearest(descriptors: NDArray[np.float32], words: NDArray[np.float32]) -> NDArray[np.intp]:
    """Return the word at the least distance of each descriptor."""
    found: NDArray[np.intp] = np.argmin((words * words).sum(axis=1) - 2.0 * (descriptors @ words.T), axis=1)
    return found


ALL_UP_TO = 30
"""Photos of which all pairs are compared as a whole."""
EXAMINED_UP_TO = 120
"""Photos of which the large features of all pairs are compared."""
_LIKELY = 40
"""Photos that each one of more is compared with."""
_AT_ONCE = 400
_SEEN = 6
"""Large features that two photos have in common by chance at most."""
_BEST = 12
"""Photos that each one is compared with whatever their large features say."""
_LEAST = 15
"""Matches that must agree, beside three times those that are near their epipolar lines by chance."""
_TOLERANCE = 4.0
"""Pixels of the reduced picture."""
_SEED = 1
_TRIALS = 2500


class View(Struct, frozen=True):
    """What is known of a photo's camera.

    Parameters
    ----------
    columns, rows : int
    focal : float
        Pixels.
    reduction : float
        Pixels of the photo in one of the picture in which features were found.
    """

    columns: int
    rows: int
    focal: float
    reduction: float


def promising_pairs(features: Sequence[Features]) -> list[tuple[int, int]]:
    """Return pairs of photos whose large features match; of few photos all pairs.

    Every photo has its best twelve partners among them: photos with little in common are not lost. Of many photos only
    those pairs are examined that retrieval takes for likely.
    """
    every = list(combinations(range(len(features)), 2))
    if len(features) <= ALL_UP_TO:
        return every
    examined = every if len(features) <= EXAMINED_UP_TO else likely_pairs(features, _LIKELY)
    score = np.zeros((len(features), len(features)), dtype=np.int32)
    with stage("likely pairs", len(examined)) as advance:
        for start in range(0, len(examined), _AT_ONCE):
            some = examined[start : start + _AT_ONCE]
            counts = by_threads(lambda pair: count_large_matches(features[pair[0]], features[pair[1]]), some, 20)
            score[tuple(np.transpose(some))] = counts
            advance(start + len(some))
    score += score.T
    chosen = score >= _SEEN
    best = np.argsort(-score, axis=1, kind="stable")[:, :_BEST]
    rows = np.arange(len(features))[:, None]
    chosen[rows, best] |= score[rows, best] > 0
    chosen |= chosen.T
    return [pair for pair in examined if chosen[pair]]


def expected_pairs(count: int, places: NDArray[np.float64] | None, most: int) -> int:
    """Return how many pairs of photos will be compared: exactly, but for more than thirty without places."""
    if places is not None:
        return len(neighbouring_pairs(places, most))
    return count * (count - 1) // 2 if count <= ALL_UP_TO else round(0.75 * _BEST * count)


def neighbouring_pairs(places: NDArray[np.float64], most: int) -> list[tuple[int, int]]:
    """Return pairs of photos of which one is among the nearest of the other.

    Parameters
    ----------
    places : ndarray (n, 2 or 3)
        Of the photos; NaN where not known: such a photo is paired with all.
    most : int
        Neighbours of a photo.
    """
    from scipy.spatial import KDTree

    known = np.flatnonzero(~np.isnan(places).any(axis=1))
    pairs = set()
    if len(known) > 1:
        count = min(most + 1, len(known))
        _, near = KDTree(places[known]).query(places[known], count)
        for one, others in zip(known.tolist(), known[np.atleast_2d(near)].tolist(), strict=True):
            pairs |= {(min(one, other), max(one, other)) for other in others if other != one}
    for one in set(range(len(places))) - set(known.tolist()):
        pairs |= {(min(one, other), max(one, other)) for other in range(len(places)) if other != one}
    return sorted((int(one), int(other)) for one, other in pairs)


def verified_matches(
    one: Features, other: Features, matches: NDArray[np.intp], views: tuple[View, View]
) -> NDArray[np.intp]:
    """Return the matches that agree with one relative orientation, or homography, of two photos; (0, 2) if few do.

    Parameters
    ----------
    matches : ndarray (n, 2)
    views : tuple of 2 View
    """
    import pycolmap

    nothing = np.zeros((0, 2), dtype=np.intp)
    if len(matches) < _LEAST:
        return nothing
    options = pycolmap.TwoViewGeometryOptions()
    options.min_num_inliers = _LEAST
    options.ransac.max_error = _TOLERANCE * max(view.reduction for view in views)
    options.ransac.random_seed = _SEED
    options.ransac.num_threads = 1
    options.ransac.max_num_trials = _TRIALS
    options.detect_watermark = False
    cameras = [
        pycolmap.Camera(
            model="SIMPLE_PINHOLE",
            width=view.columns,
            height=view.rows,
            params=[view.focal, view.columns / 2, view.rows / 2],
            has_prior_focal_length=True,
        )
        for view in views
    ]
    found = pycolmap.estimate_two_view_geometry(
        cameras[0],
        one.place[matches[:, 0]],
        cameras[1],
        other.place[matches[:, 1]],
        np.repeat(np.arange(len(matches), dtype=np.uint32)[:, None], 2, axis=1),
        options,
    )
    inliers = np.asarray(found.inlier_matches, dtype=np.intp).reshape(-1, 2)
    side = min(min(view.columns, view.rows) / view.reduction for view in views)
    by_chance = len(matches) * 4.0 * _TOLERANCE / side
    return matches[np.sort(inliers[:, 0])] if len(inliers) >= _LEAST + 3.0 * by_chance else nothing
