"""Which pairs of photos are compared, and what of their matches the geometry of two photos confirms."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from orip.pictures.matching.features import Features, count_large_matches
from orip.pictures.matching.retrieval import likely_pairs
from orip.progress import stage
from orip.threads import by_threads

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

    Parameters
    ----------
    features : sequence of Features
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
    one, other : Features
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
