"""Starting values of a spatial similarity that wrong points do not spoil."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from orip.arrays import FloatArray, IntArray
from orip.geometry.similarity import Similarities, Similarity, fit_similarities, several
from orip.prelim.compiled import is_compiled, kernels
from orip.prelim.sampling import subsets
from orip.prelim.similarity.common_points import LEAST_ERROR, CommonPoints

TRIPLES = 40, 500
"""Numbers of triples: tried first, and tried if none of those fits; the second is all triples of up to 15 points. With
half of the points wrong one triple in eight is good; 500 practically never miss it."""

FITTING = 9.0
"""d²/s² below which most points stay at a start that fits."""

MEDIAN_OF_CHI2 = 2.37
"""Median of the square sum of three standard normal residuals."""


def start_from_triples(common: CommonPoints, tried: Sequence[int] = TRIPLES) -> Similarity:
    """Return the similarity of the three points that most others agree with.

    Parameters
    ----------
    common : CommonPoints
        Three full points at least.
    tried : sequence of int
        Numbers of triples, each of which is tried if nothing fits with those before.

    Returns
    -------
    Similarity

    Raises
    ------
    ValueError
        When all triples lie on lines.
    """
    full = np.flatnonzero(common.full)
    best_of = _compiled_best_of if is_compiled() else _best_of
    for number in tried:
        found = best_of(common, full[subsets(len(full), 3, number)])
        if found is not None and (found.most <= FITTING or number == tried[-1]):
            return found.start
    message = "the common points lie on one line"
    raise ValueError(message)


class _Best(NamedTuple):
    """The best start of several, and the least d²/s² that most points stay below at one of them."""

    start: Similarity
    most: float


def _best_of(common: CommonPoints, triples: IntArray) -> _Best | None:
    """Return the best similarity of triples (s, 3) of points, None if all lie on lines."""
    starts = fit_similarities(common.source[triples], common.target[triples])
    if not len(starts.scale):
        return None
    costs, most = _compared(common, starts)
    return _Best(starts.one(int(costs.argmin())), most)


def _compiled_best_of(common: CommonPoints, triples: IntArray) -> _Best | None:
    """Do what `_best_of` does in the compiled loop."""
    start = np.empty(13)
    most = kernels.best_triple(
        *common.arrays, triples, start, most_points(len(common.source)), LEAST_ERROR, MEDIAN_OF_CHI2, FITTING
    )
    return _Best(Similarity(float(start[0]), start[1:10].reshape(3, 3), start[10:]), most) if most >= 0.0 else None


def most_points(count: int) -> int:
    """Return how many points make most of them.

    Least median of squares (Rousseeuw 1984), counted so that one wrong point of four or five does no harm.
    """
    return min(count // 2 + 2, count - 1) if count > 3 else count


def best_start(common: CommonPoints, starts: list[Similarity]) -> Similarity:
    """Return the start with the least of `truncated_costs`."""
    if len(starts) == 1:
        return starts[0]
    return starts[int(truncated_costs(common, several(starts)).argmin())]


def truncated_costs(common: CommonPoints, starts: Similarities) -> FloatArray:
    """Return the sums (s,) of min(d²/s², 9) over the points, with s² scaled to the points that fit best."""
    return _compared(common, starts)[0]


def _compared(common: CommonPoints, starts: Similarities) -> tuple[FloatArray, float]:
    """Return the truncated costs (s,) of starts, and the least d²/s² that most points stay below at one of them."""
    squares = _squares(common, starts)
    rank = most_points(squares.shape[1])
    most = float(np.partition(squares, rank - 1, axis=1)[:, rank - 1].min())
    factor = max(1.0, most / MEDIAN_OF_CHI2)
    return np.asarray(np.minimum(squares / factor, FITTING).sum(axis=1)), most


def _squares(common: CommonPoints, starts: Similarities) -> FloatArray:
    """Return d²/s² (s, n) of the points at each start, as of three coordinates."""
    known = common.known
    difference = np.where(known, starts.apply(common.source) - common.target, 0.0)
    source = (common.source_deviation**2).mean(axis=1)
    target = np.nanmean(np.where(known, common.target_deviation, np.nan) ** 2, axis=1)
    variance = target + starts.scale[:, None] ** 2 * source
    floor = LEAST_ERROR**2 * np.median(variance, axis=1, keepdims=True)
    variance = np.maximum(variance, np.where(floor > 0.0, floor, 1.0))
    return np.asarray((difference**2).sum(axis=2) / variance * (3.0 / known.sum(axis=1)))
