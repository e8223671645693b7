"""When to stop: the exponent of numerical precision, steady weights, and divergence."""

from __future__ import annotations

from collections.abc import Sequence
from enum import Enum
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

ENP_LIMIT = 15.0
"""Printed for corrections that are zero to working precision."""

_WEIGHT_CHANGE = 0.05
_DIVERGING_PASSES = 3
_HOPELESS = 3.0
"""Digits: corrections a thousand times as large as the first ones lead nowhere."""


class Termination(Enum):
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
    """Whether no weight factor changes by more than 0.05 when it is computed anew."""
    return bool(np.abs(after - before).max(initial=0.0) <= _WEIGHT_CHANGE)


def is_diverging(enps: Sequence[float]) -> bool:
    """Whether ENP fell in three iterations running and is negative, or far below where it began, or is not finite.

    A positive ENP says that corrections are smaller than the standard deviations. It falls for some iterations when
    reweighting moves from one end state to another, and then rises again.
    """
    if enps and not np.isfinite(enps[-1]):
        return True
    if enps and enps[-1] < min(enps[0], 0.0) - _HOPELESS:
        return True
    last = enps[-_DIVERGING_PASSES - 1 :]
    return len(last) > _DIVERGING_PASSES and last[-1] < 0.0 and all(b < a for a, b in pairwise(last))
