"""The Danish method: weights that fall with the standard residual, computed again after each iteration.

Krarup, Juhl and Kubik (1980) gave the principle. The function used here, exp(-u / c) above the limit c, is this
program's choice among those found under that name: it does not diverge where the steeper ones do.
"""

from __future__ import annotations

import numpy as np

from orip.arrays import FloatArray

LEAST_WEIGHT = 1e-10
"""Smallest weight: unknowns that only down-weighted observations determine remain determined."""

MEDIAN_OF_NORMAL = 0.6745
"""Median of the absolute value of a standard normal residual."""

LIMIT_OF_TWO_COMPONENTS = 3.5
"""Limit c for the length of a residual with two components: one good residual in 460 is longer."""


def danish_weights(standard_residuals: FloatArray, limit: float) -> FloatArray:
    """Return weight factors (0, 1]: 1 up to the limit, exp(-u / c) above it.

    Parameters
    ----------
    standard_residuals : array (n,)
        u = |v| / a-priori error after the iteration before.
    limit : float
        c.

    Returns
    -------
    array (n,)
    """
    reduced = np.maximum(np.exp(-standard_residuals / limit), LEAST_WEIGHT)
    return np.where(standard_residuals <= limit, 1.0, reduced)


def scaled_weights(standard_residuals: FloatArray, limit: float) -> FloatArray:
    """Return weight factors for iterations far from the solution, in which most residuals are large.

    They are (L / u)² above a limit L that is scaled by the median of the standard residuals u: only observations that
    stand out from the others lose weight, so that blunders do not spoil the first iterations. They fall more slowly
    than the Danish weights, since large residuals may come from a photo whose orientation is still wrong, which must
    stay tied to the block.

    Parameters
    ----------
    standard_residuals : array (n,)
    limit : float

    Returns
    -------
    array (n,)
    """
    if not len(standard_residuals):
        return np.ones(0)
    scale = max(float(np.median(standard_residuals)) / MEDIAN_OF_NORMAL, 1.0)
    raised = limit * scale
    return (raised / np.maximum(standard_residuals, raised)) ** 2
