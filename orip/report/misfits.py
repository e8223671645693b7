"""Observations that fit worse than chance explains, with the probable sizes of their errors."""

from __future__ import annotations

import math

import numpy as np

from orip.adjustment.outlier_tests import OutlierTest
from orip.arrays import BoolArray, IntArray
from orip.records.observations.observation_kinds import OBSERVATION_KINDS, unit_of_observation
from orip.records.results.solution import Residuals, Solution
from orip.report.numbers import SINGULAR, decimals_for, fixed

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
    names = {_key(residuals, row) for row in np.flatnonzero(misfit).tolist()}
    beside = [row for row in np.flatnonzero(down & ~misfit).tolist() if _key(residuals, row) in names]
    rows = np.concatenate([np.flatnonzero(misfit), np.array(beside, dtype=np.int64)])
    rows = np.sort(rows)
    w = residuals.w[rows]
    size = np.where(np.isnan(w), residuals.standard_residual[rows], np.abs(w))
    return np.asarray(rows[np.argsort(-size, kind="stable")])


def number_by_chance(solution: Solution, test_level: float | None = None) -> int:
    """Return how many observations have lost weight although they fit as well as chance explains."""
    residuals = solution.residuals
    names = {_key(residuals, row) for row in np.flatnonzero(residuals.weight_factor < 1.0).tolist()}
    return len(names - {_key(residuals, row) for row in suspect_rows(solution, test_level).tolist()})


def _misfit(solution: Solution, test_level: float | None) -> BoolArray:
    """Return which residuals are too large for chance; those that nothing tests if they have lost weight."""
    residuals = solution.residuals
    untested = np.isnan(residuals.w) & (residuals.weight_factor < 1.0)
    too_large = np.abs(residuals.w) > suspicious_w(solution, test_level)
    return np.asarray(untested | (too_large & (residuals.weight_factor > 0.0)))


def _key(residuals: Residuals, row: int) -> tuple[str, str, str]:
    return residuals.kind[row], residuals.photo[row], residuals.point[row]


def suspects(solution: Solution, test_level: float | None = None) -> dict[str, list[str]]:
    """Return the observations that do not fit, the worst first, with the probable size of each component's error."""
    found: dict[str, list[str]] = {}
    for row in suspect_rows(solution, test_level).tolist():
        size, component = probable_size(solution.residuals, row), solution.residuals.component[row]
        unit = "" if size == SINGULAR else unit_of_residual(solution, row)
        text = f"{component} {size} {unit}".rstrip()
        found.setdefault(observation_of(solution.residuals, row), []).append(text.strip())
    return found


def named_observation(kind: str, photo: str, point: str) -> str:
    """Return what an observation of a kind is called."""
    if kind == "photo":
        return f"photo {photo} point {point}"
    return " ".join(part for part in (OBSERVATION_KINDS[kind].label, photo, point) if part)


def observation_of(residuals: Residuals, row: int) -> str:
    """Return what an observation is called: ``photo 101 point 12``."""
    return named_observation(residuals.kind[row], residuals.photo[row], residuals.point[row])


def probable_error(residuals: Residuals, row: int) -> float:
    """Return by how much an observation is probably off: observed minus what all others predict; NaN if not tested."""
    number = residuals.redundancy_number[row]
    return float(-residuals.residual[row] / number) if number > 0.01 else math.nan


def probable_size(residuals: Residuals, row: int) -> str:
    """Return the same as text."""
    error = probable_error(residuals, row)
    return SINGULAR if math.isnan(error) else fixed(error, decimals_for([residuals.a_priori[row]]))


def unit_of_residual(solution: Solution, row: int) -> str:
    """Return the unit of a residual."""
    residuals = solution.residuals
    return unit_of_observation(residuals.kind[row], residuals.component[row], solution.ground_unit)
