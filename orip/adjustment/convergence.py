"""When to stop: the exponent of numerical precision and the tests of convergence and divergence."""

from __future__ import annotations

from collections.abc import Sequence
from enum import Enum
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from orip.arrays import parts
from orip.threads import by_threads

ENP_LIMIT = 15.0
"""Printed for corrections that are zero to working precision."""

_WEIGHT_CHANGE = 0.05

_LEAST_COMPUTABLE = 0.5
"""Diverged once less than this part of the observations can be computed."""

_FALLING_ITERATIONS = 3
_FALLEN_DIGITS = 3.0
"""Diverged once corrections are a thousand times as large as the first ones."""


class TerminationReason(Enum):
    """Why the iterations ended."""

    CONVERGED = "converged"
    MAX_ITERATIONS = "not converged within the allowed iterations"
    DIVERGED = "diverged"
    STOPPED = "stopped by the operator"


def exponent_of_numerical_precision(reduced_square_sum: float, unknowns: int) -> float:
    """Return ENP = -1/2 log10(dx^T N dx / u): the digits by which corrections undercut their standard deviations.

    Parameters
    ----------
    reduced_square_sum : float
        dx^T N dx, the square sum of the reduced right-hand side.
    unknowns : int
        Unknowns that took part.

    Notes
    -----
    Krarup (1982) introduced the measure; the formula is this program's reading of it (docs/decisions).
    """
    if not np.isfinite(reduced_square_sum):
        return -np.inf
    mean = reduced_square_sum / max(unknowns, 1)
    return ENP_LIMIT if mean < 10.0 ** (-2.0 * ENP_LIMIT) else float(-0.5 * np.log10(mean))


def weights_are_steady(before: NDArray[np.float64], after: NDArray[np.float64]) -> bool:
    """Return whether no weight factor changes by more than 0.05 from one iteration to the next."""

    def is_steady(part: slice) -> bool:
        return bool(np.abs(after[part] - before[part]).max() <= _WEIGHT_CHANGE)

    return all(by_threads(is_steady, parts(len(after))))


def is_diverging(enps: Sequence[float]) -> bool:
    """Return whether corrections grow: by the ENP of successive iterations with the same weight function.

    That is where ENP fell in three successive iterations and is negative, is three digits below the first one (or below
    zero), or is not finite. A positive ENP says that corrections are smaller than the standard deviations; it may fall
    for some iterations while weights change from one solution to another.
    """
    if enps and not np.isfinite(enps[-1]):
        return True
    if enps and enps[-1] < min(enps[0], 0.0) - _FALLEN_DIGITS:
        return True
    last = enps[-_FALLING_ITERATIONS - 1 :]
    return len(last) > _FALLING_ITERATIONS and last[-1] < 0.0 and all(b < a for a, b in pairwise(last))


def most_are_lost(computable: int, at_first: int) -> bool:
    """Return whether too few of the observations that could be computed at first can be computed now."""
    return computable < _LEAST_COMPUTABLE * at_first
