"""Tests for outliers and for groups of residuals: the limits that they are compared with."""

from __future__ import annotations

import numpy as np
from msgspec import Struct
from scipy.special import chdtri, fdtri, gammaincc, gammaln, log_ndtr, ndtri, stdtrit

from orip.arrays import FloatArray
from orip.structs import replace

# An observation in use is tested by its normalised residual w, a group of k of them by the fall of the weighted square
# sum when it is left out; of one observation that fall is w². With a known sigma0 w is normal and the fall chi-square
# distributed (Baarda 1968). With sigma0 from the same adjustment w follows the tau distribution (Pope 1976), and the
# fall is a part of the square sum that Fisher's F limits.
#
# An observation that is left out has no share in sigma0: its deviation from its prediction follows Student's t, and the
# rise of the square sum when a group is taken back Fisher's F. The quantiles come from scipy.special; importing
# scipy.stats would take a second.

LEAST_SIGMA0 = 1e-6
"""A sigma0 below it comes from observations without errors: their residuals are rounding, not blunders."""


class OutlierTest(Struct, frozen=True):
    """How residuals are tested.

    Parameters
    ----------
    alpha : float
        Error probability of one two-sided test.
    sigma0 : float
        The a-posteriori standard error, or 1.
    redundancy : int or None
        That sigma0 was estimated with; None: sigma0 is known a priori.
    """

    alpha: float
    sigma0: float
    redundancy: int | None

    def limit(self, among: int = 1) -> float:
        """Return the limit of w of an observation in use, or of the largest of several (Bonferroni)."""
        alpha = self.alpha / among
        if self.redundancy is None:
            return float(-ndtri(alpha / 2.0))
        freedom = self.redundancy
        if freedom < 2:
            return float("inf")
        t = float(stdtrit(freedom - 1, 1.0 - alpha / 2.0))
        return float(np.sqrt(freedom) * t / np.sqrt(freedom - 1 + t * t))

    def group_limit(self, size: int) -> float:
        """Return the limit of the root of the fall, in units of sigma0, when `size` observations are left out."""
        if self.redundancy is None:
            return float(np.sqrt(chdtri(size, self.alpha)))
        left = self.redundancy - size
        if left < 1:
            return float("inf")
        # fdtri takes the probability below the quantile
        rise = size * float(fdtri(size, left, 1.0 - self.alpha))
        return float(np.sqrt(self.redundancy * rise / (left + rise)))

    def limit_of_left_out(self, among: int = 1) -> float:
        """Return the limit of the deviation of an observation left out from its prediction, divided by its sd."""
        alpha = self.alpha / among
        if self.redundancy is None:
            return float(-ndtri(alpha / 2.0))
        return float(stdtrit(self.redundancy, 1.0 - alpha / 2.0)) if self.redundancy > 0 else float("inf")

    def group_limit_of_left_out(self, size: int) -> float:
        """Return the limit of the root of the rise, in units of sigma0, when `size` observations are taken back."""
        if self.redundancy is None:
            return float(np.sqrt(chdtri(size, self.alpha)))
        return float(np.sqrt(size * fdtri(size, self.redundancy, 1.0 - self.alpha))) if self.redundancy else np.inf

    def after(self, fall: float, size: int) -> OutlierTest:
        """Return the test once `size` observations are left out, by which the square sum falls.

        Both are negative for observations that are taken back.
        """
        if self.redundancy is None:
            return self
        left = self.redundancy - size
        variance = max(self.redundancy * self.sigma0**2 - fall, 0.0) / max(left, 1)
        return replace(self, redundancy=max(left, 0), sigma0=max(float(np.sqrt(variance)), LEAST_SIGMA0))


# Probabilities are given as natural logarithms, so that the most significant of several tests is known even where the
# probabilities themselves underflow. Special functions come from scipy.special; importing scipy.stats would take a
# second.

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
