"""Tests for outliers: the limits that normalised residuals and groups of residuals are compared with.

An observation in use is tested by its normalised residual w, a group of k of them by the fall of the weighted square
sum when it is left out; of one observation that fall is w². With a known sigma0 w is normal and the fall chi-square
distributed (Baarda 1968). With sigma0 from the same adjustment w follows the tau distribution (Pope 1976), and the fall
is a part of the square sum that Fisher's F limits.

An observation that is left out has no share in sigma0: its deviation from its prediction follows Student's t, and the
rise of the square sum when a group is taken back Fisher's F. The quantiles come from scipy.special; importing
scipy.stats would take a second.
"""

from __future__ import annotations

import numpy as np
from msgspec import Struct
from scipy.special import chdtri, fdtri, ndtri, stdtrit

from orip.structs import replace

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
