"""The Danish method: weights that fall with the standard residual, decided anew after each iteration.

Krarup, Juhl and Kubik (1980) gave the principle. The function used here, exp(-u / c) above the limit c, is this
program's choice among those found under that name: it does not diverge where the steeper ones do.
"""

from __future__ import annotations

import numpy as np

from orip.arrays import FloatArray

LEAST_WEIGHT = 1e-10
"""Next to nothing, and yet enough to determine what only down-weighted observations determine."""

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


def settling_weights(standard_residuals: FloatArray, limit: float) -> FloatArray:
    """Return weight factors while corrections are still large, and residuals hold what they will take away.

    The limit L is as many times higher as most residuals are larger than their a-priori errors: only what sticks out of
    the others loses weight, so that blunders do not lead the first iterations astray. It falls with (L / u)² alone,
    since what seems to be blunders may be a whole photo that is not in its place yet, and must not come loose.

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
