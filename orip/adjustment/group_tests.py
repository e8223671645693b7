"""Tests of groups of residuals: square sums and means larger than chance explains.

Probabilities are given as natural logarithms, so that the most significant of several tests is known even where the
probabilities themselves underflow. Special functions come from scipy.special; importing scipy.stats would take a
second.
"""

from __future__ import annotations

import numpy as np
from scipy.special import gammaincc, gammaln, log_ndtr

from orip.arrays import FloatArray

_SMALL = 1e-280
"""Below this a probability of the chi-square distribution is about to underflow, or has."""


def two_sided_normal(statistic: FloatArray | float) -> FloatArray:
    """Return the logarithm of the probability that a standard normal variable is as far from zero."""
    return np.asarray(np.minimum(np.log(2.0) + log_ndtr(-np.abs(statistic)), 0.0))


def chi_square_tail(statistic: float, freedom: float) -> float:
    """Return the logarithm of the probability that a chi-square variable is as large or larger.

    Far out it comes from the first convergent of Legendre's continued fraction for the incomplete gamma function
    (Abramowitz and Stegun 1964, 6.5.31).
    """
    a, x = freedom / 2.0, max(statistic, 0.0) / 2.0
    tail = float(gammaincc(a, x))
    if tail > _SMALL:
        return float(np.log(tail))
    return float(a * np.log(x) - x - gammaln(a) - np.log(x + 1.0 - a))


def square_sum_tail(square_sum: float, covariance: FloatArray) -> float:
    """Return the logarithm of the probability that correlated residuals have so large a square sum, or a larger one.

    The square sum is distributed as the sum of one chi-square variable for each eigenvalue of the covariance, times
    that eigenvalue. It is taken as a shifted and scaled chi-square variable with the same mean, variance and skewness
    (Imhof 1961, *Computing the distribution of quadratic forms in normal variables*, equation 5.1).

    Parameters
    ----------
    square_sum : float
    covariance : array (k, k)
        Of the residuals.
    """
    values = np.maximum(np.linalg.eigvalsh(covariance), 0.0)
    mean, variance, third = (float(np.sum(values**power)) for power in (1, 2, 3))
    if not third > 0.0:
        return 0.0
    freedom = variance**3 / third**2
    statistic = (square_sum - mean) * np.sqrt(freedom / variance) + freedom
    return chi_square_tail(float(statistic), freedom)


def generalised_square_tail(residuals: FloatArray, covariance: FloatArray) -> tuple[float, float]:
    """Return v^T C^-1 v of residuals (k,) with a regular covariance C, and the logarithm of its tail probability."""
    quantity = float(residuals @ np.linalg.solve(covariance, residuals))
    return quantity, chi_square_tail(quantity, float(len(residuals)))


def against_others(residuals: FloatArray, covariance: FloatArray) -> FloatArray:
    """Return how far each residual (k,) is from what the others predict of it, in standard deviations of that.

    With the inverse P of the covariance it is |P v| over the roots of the diagonal of P: the largest is the most
    powerful test against one wrong observation.
    """
    inverse = np.linalg.inv(covariance)
    return np.asarray(np.abs(inverse @ residuals) / np.sqrt(np.diag(inverse)))


def largest_of(log_probability: float, count: int) -> float:
    """Return the logarithm of a bound of the probability that the least likely of several tests is so unlikely."""
    return min(log_probability + float(np.log(count)), 0.0)
