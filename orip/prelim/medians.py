"""Medians of a few numbers, ten times as fast as those of NumPy, which look for NaN and take any axis."""

from __future__ import annotations

import numpy as np

from orip.arrays import FloatArray


def medians(values: FloatArray) -> FloatArray:
    """Return the median of each column, ten times as fast as `np.median` for a few numbers.

    Parameters
    ----------
    values : array (n, k)
        Finite; n > 0.

    Returns
    -------
    array (k,)
    """
    lower, upper = (len(values) - 1) // 2, len(values) // 2
    ordered = np.partition(values, (lower, upper), axis=0)
    return np.asarray(0.5 * (ordered[lower] + ordered[upper]))


def median(values: FloatArray) -> float:
    """Return the median of finite numbers in an array of any shape, at least one."""
    return float(medians(values.ravel()))
