"""The Danish method: weights that fall with the standard residual, computed again after each iteration.

Krarup, Juhl and Kubik (1980) gave the principle. The function used here, exp(-u / c) above the limit c, is this
program's choice among those found under that name: it does not diverge where the steeper ones do.
"""

from __future__ import annotations

import numpy as np

from orip.arrays import FloatArray

LEAST_WEIGHT = 1e-10
"""Smallest weight: unknowns that only down-weighted observations determine remain determined."""

_NO_INFLUENCE = 0.01
"""Weighted square of a residual that is of no influence."""

MEDIAN_OF_NORMAL = 0.6745
"""Median of the absolute value of a standard normal residual."""

LIMIT_OF_TWO_COMPONENTS = 3.5
"""Limit c for the length of a residual with two components: one good residual in 460 is longer."""


def _least_weights(standard_residuals: FloatArray) -> FloatArray:
    """Return weights (n,) with which no residual has an influence, however large it is.

    Beside a projection centre residuals, and with them the partial derivatives, are of any size.
    """
    return np.minimum(LEAST_WEIGHT, _NO_INFLUENCE / np.maximum(standard_residuals, 1.0) ** 2)


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
    reduced = np.maximum(np.exp(-standard_residuals / limit), _least_weights(standard_residuals))
    return np.where(standard_residuals <= limit, 1.0, reduced)


def danish_costs(standard_residuals: FloatArray, limit: float) -> FloatArray:
    """Return what each residual adds to the robust cost: the integral of u wf(u), at most `greatest_danish_cost`.

    Iterations with weights computed again minimise the sum of these costs (Holland and Welsch 1977).

    Parameters
    ----------
    standard_residuals : array (n,)
    limit : float

    Returns
    -------
    array (n,)
        u²/2 up to the limit c, c² (1/2 + 2/e - (1 + u/c) exp(-u/c)) above it.
    """
    parts = np.maximum(standard_residuals, limit) / limit
    above = greatest_danish_cost(limit) - limit**2 * (1.0 + parts) * np.exp(-parts)
    return np.where(standard_residuals <= limit, standard_residuals**2 / 2.0, above)


def greatest_danish_cost(limit: float) -> float:
    """Return what a residual of any size adds to the robust cost at most."""
    return limit**2 * (0.5 + 2.0 / float(np.e))


def wide_weights(standard_residuals: FloatArray, limit: float, exponent: int) -> FloatArray:
    """Return weight factors for iterations that are not near the solution yet: 1 up to the limit L, (L / u)^p above it.

    They fall more slowly than the Danish weights, since large residuals may come from a photo whose orientation is
    still wrong, which must stay tied to the block.

    Parameters
    ----------
    standard_residuals : array (n,)
    limit : float
    exponent : int
        2; or 3 where many observations are wrong: it falls fast enough that a fifth of these does not move the block.
    """
    reduced = (limit / np.maximum(standard_residuals, limit)) ** exponent
    return np.maximum(reduced, _least_weights(standard_residuals))


def wide_costs(standard_residuals: FloatArray, limit: float) -> FloatArray:
    """Return what each residual adds to the cost that wide weights of exponent 3 minimise: L² (3/2 - L / u) above L."""
    above = limit**2 * (1.5 - limit / np.maximum(standard_residuals, limit))
    return np.where(standard_residuals <= limit, standard_residuals**2 / 2.0, above)


def robust_scale(standard_residuals: FloatArray) -> float:
    """Return the scale of residuals, most of which are normal: the median of their sizes over that of normal ones.

    Up to half of them may be of any size. 1 without residuals.
    """
    if not len(standard_residuals):
        return 1.0
    return float(np.median(standard_residuals)) / MEDIAN_OF_NORMAL
