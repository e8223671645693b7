"""Starting values of a relative orientation without initial values: samples of five points, judged by all others.

The judgement has to tolerate gross errors, and residuals that are all many times the a-priori error (a camera that is
not calibrated). It therefore estimates the scale of the residuals: see `Consensus`. A residual above three times that
scale counts as three.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from orip.arrays import FloatArray, IntArray
from orip.geometry.essential import TwoPhotos, essential_matrices, two_photos_of
from orip.prelim.relative.adjustment import Pairs, meeting_points, parallaxes
from orip.prelim.sampling import subsets

POINTS_NEEDED = 5

_SEED = 5
_SAMPLES = 500
_SAMPLES_AT_ONCE = 12
"""As many samples as points without blunders need; the share that agrees in the best one then decides on more."""

_MISSED = 1e-3
"""Probability that all samples have a blunder, at which sampling ends."""

_ORDINARY_SCALE = 3.0
_SAMPLES_OF_LARGE_SCALE = 160
"""Least samples where residuals are large, as no good one may have been drawn; 160 suffice for 50 % of blunders."""

_NO_BETTER = 2.0
"""Residual in units of the a-priori error below which smaller ones are no better."""

FIT_LIMIT = 3.0
"""Multiple of the scale above which a point does not fit."""

_KEPT, _STARTS = 16, 8
"""Matrices that are kept from one lot of samples to the next, and orientations tried in the adjustment: of the kept
matrices, those with the points in front."""

_ALIKE = 0.999
"""Product of two matrices of norm 1 above which they count as one, some 2.5 degrees apart: a plane has a second
solution that fits as well, and its samples must not crowd out those of the first."""

SAMPLING = (
    _SAMPLES_AT_ONCE, _MISSED, _ORDINARY_SCALE, _SAMPLES_OF_LARGE_SCALE, _NO_BETTER, FIT_LIMIT, _ALIKE, _KEPT, _STARTS,
)  # fmt: skip
"""The constants as the compiled loop takes them: `Sampling` in pair_loops.h."""


def starting_orientations(pairs: Pairs) -> TwoPhotos:
    """Return the best orientations that samples of five points give, best first.

    Parameters
    ----------
    pairs : Pairs
        n >= 5 points.

    Returns
    -------
    TwoPhotos
        At most eight, many of them close to each other; none where the points determine nothing.
    """
    samples = samples_of(len(pairs.error))
    best = _Best(np.empty((0, 3, 3)), 1.0, 0.0)
    for start in range(0, len(samples), _SAMPLES_AT_ONCE):
        drawn = samples[start : start + _SAMPLES_AT_ONCE]
        best = _with_samples(best.essential, drawn, pairs)
        if len(best.essential) and start + len(drawn) >= _samples_needed(best.share, best.scale):
            break
    return best_in_front(best.essential, pairs, best.scale)


@lru_cache(maxsize=256)
def samples_of(count: int) -> IntArray:
    """Return samples of five of `count` points."""
    # if all subsets are taken they come in order, and the first of them have points in common
    return np.random.default_rng(_SEED).permutation(subsets(count, POINTS_NEEDED, _SAMPLES, _SEED))


class _Best(NamedTuple):
    """Essential matrices (k, 3, 3), the best first, and the scale and share of the points that agree in the first."""

    essential: FloatArray
    scale: float
    share: float


def _with_samples(kept: FloatArray, drawn: IntArray, pairs: Pairs) -> _Best:
    """Return the best matrices of those kept so far and those of more samples."""
    essential = np.concatenate([kept, essential_matrices(pairs.left[drawn], pairs.right[drawn])])
    if not len(essential):
        return _Best(essential, 1.0, 0.0)
    residuals = np.abs(parallaxes(essential, pairs)) / pairs.error
    agreed = consensus(residuals, pairs)
    scale, share = float(agreed.scale[agreed.best]), float(agreed.share[agreed.best])
    return _Best(essential[best_unlike(essential, robust_costs(residuals, scale))], scale, share)


class Consensus(NamedTuple):
    """How many points agree in each of several adjustments, and how well.

    Attributes
    ----------
    log_chance : array (k,)
        Logarithm of how many sets of so many points would agree so well if the points were placed at random: above 0
        the agreement says nothing.
    scale : array (k,)
        Standard residual of the points that agree, at least 1: never better than the a-priori error.
    share : array (k,)
        Of the points that agree.
    """

    log_chance: FloatArray
    scale: FloatArray
    share: FloatArray

    @property
    def best(self) -> int:
        """The adjustment that chance explains least."""
        return int(self.log_chance.argmin())


def consensus(residuals: FloatArray, pairs: Pairs) -> Consensus:
    """Return how many points agree in adjustments with five unknowns.

    Parameters
    ----------
    residuals : array (k, n)
        Absolute parallaxes in units of their a-priori error.
    pairs : Pairs

    Returns
    -------
    Consensus

    Notes
    -----
    A-contrario (Moisan and Stival 2004): m of n points have residuals up to e by chance in (n - 5) C(n, m) C(m, 5)
    p^(m - 5) sets, with the probability p = 2 e / extent of the points; the m for which this number is smallest is
    taken. Neither the scale nor the share of blunders has to be known.
    """
    rows, n = residuals.shape
    if n <= POINTS_NEEDED:
        return Consensus(np.zeros(rows), np.ones(rows), np.ones(rows))
    unit = chance_of_unit(pairs)
    ordered = np.sort(residuals, axis=1)
    agreeing = np.arange(POINTS_NEEDED + 1, n + 1)
    largest = np.clip(np.maximum(ordered[:, POINTS_NEEDED:], _NO_BETTER) * unit, 1e-300, 1.0)
    log_chance = log_of_sets(n) + (agreeing - POINTS_NEEDED) * np.log(largest)
    which = log_chance.argmin(axis=1)
    row, count = np.arange(rows), agreeing[which]
    square = np.cumsum(ordered**2, axis=1)[row, count - 1] / (count - POINTS_NEEDED)
    return Consensus(log_chance[row, which], np.maximum(np.sqrt(square), 1.0), count / n)


def chance_of_unit(pairs: Pairs) -> float:
    """Return the probability that a point placed at random has a parallax up to its a-priori error."""
    extent = max(math.hypot(*(xy[:, :2].max(axis=0) - xy[:, :2].min(axis=0))) for xy in (pairs.left, pairs.right))
    return 2.0 * float(pairs.error.mean()) / max(extent, 1e-300)


@lru_cache(maxsize=256)
def log_of_sets(n: int) -> FloatArray:
    """Return the logarithm of (n - 5) C(n, m) C(m, 5) for m from 6 to n."""
    sets = [math.comb(n, m) * math.comb(m, POINTS_NEEDED) for m in range(POINTS_NEEDED + 1, n + 1)]
    return np.array([math.log(n - POINTS_NEEDED) + math.log(number) for number in sets])


def costs_in_front(residuals: FloatArray, in_front: NDArray[np.bool_], scale: float) -> FloatArray:
    """Return the sums of squared residuals in units of the scale; a point behind a photo counts as not fitting."""
    return robust_costs(np.where(in_front, residuals, np.inf), scale)


def robust_costs(residuals: FloatArray, scale: float) -> FloatArray:
    """Return the sums of squared residuals (..., n) in units of the scale, each counted up to the limit."""
    return np.asarray((np.minimum(residuals / scale, FIT_LIMIT) ** 2).sum(axis=-1))


def _samples_needed(share: float, scale: float) -> float:
    """Return how many samples make it likely that one of them is free of blunders."""
    free = min(share**POINTS_NEEDED, 1.0 - 1e-12)
    needed = math.log(_MISSED) / math.log1p(-free)
    return max(needed, _SAMPLES_OF_LARGE_SCALE if scale > _ORDINARY_SCALE else 0.0)


def best_unlike(essential: FloatArray, costs: FloatArray) -> IntArray:
    """Return the rows of the best matrices that are not alike."""
    order = np.argsort(costs, kind="stable")
    flat = essential.reshape(-1, 9)
    chosen: list[np.int64] = []
    while len(order) and len(chosen) < _KEPT:
        chosen.append(order[0])
        order = order[np.abs(flat[order] @ flat[order[0]]) < _ALIKE]
    return np.array(chosen, dtype=np.int64)


def best_in_front(essential: FloatArray, pairs: Pairs, scale: float) -> TwoPhotos:
    """Return of each matrix the orientation with the most points in front, the best orientations first."""
    photos = two_photos_of(essential)
    residuals = np.abs(parallaxes(essential, pairs)) / pairs.error
    costs = costs_in_front(residuals[:, None], meeting_points(photos, pairs).in_front, scale)
    rows = np.arange(len(essential))
    which = costs.argmin(axis=1)
    order = np.argsort(costs[rows, which], kind="stable")[:_STARTS]
    return TwoPhotos(photos.base[rows, which], photos.rotation[rows, which]).of(order)
