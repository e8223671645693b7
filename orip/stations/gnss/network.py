"""A network of baselines with one mark held: places with their joint covariance, and baselines that do not fit.

All baselines of receivers that observed at the same time are used. Those of n receivers say no more than n - 1 of them:
each counts 2/n, which gives the places and the covariances of a solution of all receivers together (Craymer and Beck
1992, Session versus single-baseline GPS processing, ION GPS-92).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from msgspec import Struct
from scipy.stats import chi2

from orip.arrays import BoolArray, FloatArray

_ERROR_PROBABILITY = 0.01
"""That any baseline of a network is called wrong which is right."""

_ROUNDING = 1e-4
"""Metres, to which RTKLIB gives coordinates."""


class Baseline(Struct, frozen=True):
    """From one mark to another, by their numbers.

    Parameters
    ----------
    first, second : int
    vector : array (3,)
        Geocentric, m.
    covariance : array (3, 3)
        By itself, m².
    receivers : int
        That observed at the same time.
    """

    first: int
    second: int
    vector: FloatArray
    covariance: FloatArray
    receivers: int = 2


class Network(Struct, frozen=True):
    """n marks by b baselines.

    Parameters
    ----------
    place : array (n, 3)
        Geocentric, m.
    covariance : array (3 n, 3 n)
        m²; zero for the mark that is held.
    residual : array (b, 3)
        Adjusted less observed, m.
    is_wrong : array (b,) of bool
        A baseline does not fit the others.
    sigma0 : float
        NaN without redundancy. Covariances are multiplied by its square where it is above 1: residuals of simultaneous
        baselines are smaller than their errors, and say nothing where they are small.
    redundancy : int
    """

    place: FloatArray
    covariance: FloatArray
    residual: FloatArray
    is_wrong: BoolArray
    sigma0: float
    redundancy: int


def unreached(count: int, held: int, pairs: Sequence[tuple[int, int]]) -> list[int]:
    """Return the marks that no baselines join with the one that is held."""
    reached, grows = {held}, True
    while grows:
        more = {mark for pair in pairs if reached & set(pair) for mark in pair}
        grows = not more <= reached
        reached |= more
    return [mark for mark in range(count) if mark not in reached]


def adjust_network(count: int, held: int, place: FloatArray, baselines: Sequence[Baseline]) -> Network:
    """Return the places of `count` marks, all joined by baselines; `place` (3,) is that of the one held."""
    free = [mark for mark in range(count) if mark != held]
    column = {mark: 3 * at for at, mark in enumerate(free)}
    design, observed = np.zeros((3 * len(baselines), 3 * len(free))), np.zeros(3 * len(baselines))
    weight = np.zeros((len(observed), len(observed)))
    for row, line in enumerate(baselines):
        rows = slice(3 * row, 3 * row + 3)
        observed[rows] = line.vector
        for mark, sign in ((line.second, 1.0), (line.first, -1.0)):
            if mark == held:
                observed[rows] -= sign * place
            else:
                design[rows, column[mark] : column[mark] + 3] = sign * np.eye(3)
        own = line.covariance + np.eye(3) * _ROUNDING**2 / 12.0
        weight[rows, rows] = np.linalg.inv(own * line.receivers / 2.0)
    cofactor = np.linalg.inv(design.T @ weight @ design)
    found = cofactor @ (design.T @ weight @ observed)
    residual = design @ found - observed
    redundancy = len(observed) - len(found)
    sigma0 = float(np.sqrt(residual @ weight @ residual / redundancy)) if redundancy else np.nan
    places, covariance = np.tile(place, (count, 1)), np.zeros((3 * count, 3 * count))
    at = np.concatenate([np.arange(3 * mark, 3 * mark + 3) for mark in free])
    places.reshape(-1)[at] = found
    covariance[np.ix_(at, at)] = cofactor * (max(sigma0, 1.0) ** 2 if redundancy else 1.0)
    return Network(
        places, covariance, residual.reshape(-1, 3), _wrong(residual, weight, design @ cofactor @ design.T),
        sigma0, redundancy,
    )  # fmt: skip


def _wrong(residual: FloatArray, weight: FloatArray, adjusted: FloatArray) -> BoolArray:
    """Return the baseline that leaving out would better most, if that is significant: a group of three observations."""
    cofactor = np.linalg.inv(weight) - adjusted
    statistic = np.zeros(len(residual) // 3)
    for row in range(len(statistic)):
        at = slice(3 * row, 3 * row + 3)
        own = weight[at, at] @ cofactor[at, at] @ weight[at, at]
        if np.linalg.cond(own) < 1e10:
            weighted = weight[at, at] @ residual[at]
            statistic[row] = weighted @ np.linalg.solve(own, weighted)
    wrong = np.zeros(len(statistic), dtype=np.bool_)
    worst = int(np.argmax(statistic))
    wrong[worst] = statistic[worst] > chi2.isf(_ERROR_PROBABILITY / len(statistic), 3)
    return wrong
