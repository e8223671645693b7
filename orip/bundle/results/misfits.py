"""Observations that fit worse than chance explains."""

from __future__ import annotations

import numpy as np

from orip.adjustment.outlier_tests import OutlierTest
from orip.arrays import BoolArray, IntArray
from orip.records.results.solution import Residuals, Solution

FAMILY_ALPHA = 0.05
"""Probability that anything is listed as misfitting in a block without blunders."""

_LARGEST_ALPHA = 0.001
"""Error probability of one normalised residual in a block of few observations."""


def suspicious_w(solution: Solution, test_level: float | None = None) -> float:
    """Return the limit of normalised residuals.

    Parameters
    ----------
    solution : Solution
    test_level : float or None
        Error probability of one test, as it is classical; None: the limit grows with the number of tests, so that that
        of all together is `FAMILY_ALPHA`.
    """
    residuals = solution.residuals
    tested = int(np.count_nonzero(np.isfinite(residuals.w) & (residuals.weight_factor > 0.0)))
    alpha = min(FAMILY_ALPHA / max(tested, 1), _LARGEST_ALPHA) if test_level is None else test_level
    return OutlierTest(alpha, 1.0, max(solution.redundancy, 0)).limit()


def suspect_rows(solution: Solution, test_level: float | None = None) -> IntArray:
    """Return the rows of the observations that fit worse than chance explains, the worst first.

    All components are listed that have lost weight together with one that does not fit.
    """
    residuals = solution.residuals
    down, misfit = residuals.weight_factor < 1.0, _misfit(solution, test_level)
    names = _observations(residuals, np.flatnonzero(misfit))
    beside = [row for row in np.flatnonzero(down & ~misfit).tolist() if _key(residuals, row) in names]
    rows = np.concatenate([np.flatnonzero(misfit), np.array(beside, dtype=np.int64)])
    rows = np.sort(rows)
    w = residuals.w[rows]
    size = np.where(np.isnan(w), residuals.standard_residual[rows], np.abs(w))
    return np.asarray(rows[np.argsort(-size, kind="stable")])


def number_by_chance(solution: Solution, test_level: float | None = None) -> int:
    """Return how many observations have lost weight although they fit as well as chance explains."""
    residuals = solution.residuals
    names = _observations(residuals, np.flatnonzero(residuals.weight_factor < 1.0))
    return len(names - _observations(residuals, suspect_rows(solution, test_level)))


def has_suspects(solution: Solution) -> bool:
    """Tell whether any observation fits worse than chance explains."""
    return bool(_misfit(solution, None).any())


def _misfit(solution: Solution, test_level: float | None) -> BoolArray:
    """Return which residuals are too large for chance; those that nothing tests if they have lost weight."""
    residuals = solution.residuals
    untested = np.isnan(residuals.w) & (residuals.weight_factor < 1.0)
    too_large = np.abs(residuals.w) > suspicious_w(solution, test_level)
    return np.asarray(untested | (too_large & (residuals.weight_factor > 0.0)))


def _observations(residuals: Residuals, rows: IntArray) -> set[tuple[str, str, str]]:
    return {_key(residuals, row) for row in rows.tolist()}


def _key(residuals: Residuals, row: int) -> tuple[str, str, str]:
    return residuals.kind[row], residuals.photo[row], residuals.point[row]
