"""Two adjustments of the same observations compared: whether one explains what the other leaves unexplained.

The question comes up when an adjustment does not fit, and the same data would if something had been written otherwise:
the rows of a camera counted the other way, a lens exchanged. Each observation fits one of the two, both or neither;
those that fit one alone decide, by the sign test (McNemar, 1947). It asks nothing of the size of residuals that are far
too large, nor of their distribution.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from orip.adjustment.weights import MEDIAN_OF_NORMAL
from orip.arrays import FloatArray
from orip.bundle.solve import SolvedBlock
from orip.records.solution import Solution

_FITS = 3.0
"""Standard errors, taken from the better one of the two adjustments."""

_SIGN_TEST = 3.7
"""Quantile of the normal distribution, error probability 1e-4: some ten ways of writing something are tried."""

_FAR_OFF, _FEW = 10.0, 4
"""An observation that is off by ten times the limit comes to fit by chance with a probability of a tenth at most, four
of them with 1e-4."""

_EXPLAINED = 0.5
"""Part of the misfits that has to go."""

_GOOD_SCALE, _BLUNDERS = 1.5, 0.05
"""Standard error of unit weight, and part of the observations that may be blunders, in an adjustment that fits."""


@dataclass(frozen=True, slots=True)
class Fit:
    """How the observations of an adjustment fit.

    Parameters
    ----------
    columns : four sequences of length n
        Kind, photo, point and component of the observations.
    standard : array (n,)
        Standard residuals; infinite for what could not be computed, as a point behind its photo.
    """

    columns: tuple[Sequence[str], Sequence[str], Sequence[str], Sequence[str]]
    standard: FloatArray

    @property
    def observations(self) -> tuple[tuple[str, str, str, str], ...]:
        """Return the names of the observations."""
        # made when asked for: in a large block they take more memory than all figures
        return tuple(zip(*self.columns, strict=True))

    @property
    def scale(self) -> float:
        """Return the standard error of unit weight as the median tells it, at least 1."""
        return max(1.0, float(np.median(self.standard)) / MEDIAN_OF_NORMAL)

    def of(self, observations: tuple[tuple[str, str, str, str], ...]) -> FloatArray:
        """Return the standard residuals of some observations; infinite for those that are not there."""
        if observations == self.observations:
            return self.standard
        place = dict(zip(self.observations, self.standard.tolist(), strict=True))
        return np.array([place.get(each, np.inf) for each in observations])


def fit_of_solution(solution: Solution) -> Fit:
    """Return how the observations fit a solution."""
    rows = solution.residuals
    names = (rows.kind, rows.photo, rows.point, rows.component)
    standard = np.where(np.isnan(rows.weight_factor), np.inf, rows.standard_residual)
    return Fit(names, np.where(np.isfinite(standard), standard, np.inf))


def fit_of_adjustment(solved: SolvedBlock) -> Fit:
    """Return how the observations fit an adjustment."""
    rows = [each.rows for each in solved.problem.observations]
    names = (
        [each.kind for each in rows for _ in each.photo],
        [name for each in rows for name in each.photo],
        [name for each in rows for name in each.point],
        [name for each in rows for name in each.component],
    )
    equations = solved.adjusted.linearised.equations
    standard = np.where(equations.active, np.abs(equations.residual), np.inf)
    return Fit(names, np.where(np.isfinite(standard), standard, np.inf))


def explains(other: Fit, given: Fit) -> bool:
    """Tell whether another adjustment explains what the given one does not.

    Few observations decide, too, where they are off by far: control that a block is bent to fits in most coordinates.
    """
    limit = _FITS * min(other.scale, given.scale)
    before = given.of(other.observations)
    counted = ~(np.isinf(before) & np.isinf(other.standard))
    before, after = before[counted], other.standard[counted]
    if np.count_nonzero(after > limit) > _EXPLAINED * np.count_nonzero(before > limit):
        return False
    gained, lost = after <= limit, before <= limit
    gained, lost = gained & ~lost, lost & ~gained
    few = np.count_nonzero(gained & (before > _FAR_OFF * limit))
    if few >= _FEW and not (lost & (after > 2.0 * limit)).any():
        return True
    count, lost_count = np.count_nonzero(gained), np.count_nonzero(lost)
    return bool(count - lost_count >= _SIGN_TEST * np.sqrt(count + lost_count) and count > 0)


def is_good(fit: Fit) -> bool:
    """Tell whether observations fit within their a-priori errors, but for blunders: nothing better is to be found."""
    return fit.scale < _GOOD_SCALE and misfit(fit, 1.0) < _BLUNDERS


def misfit(fit: Fit, scale: float) -> float:
    """Return the part of the observations that does not fit, when their standard error of unit weight is `scale`."""
    return float(np.mean(fit.standard > _FITS * scale))
