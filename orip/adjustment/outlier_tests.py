"""Tests for outliers: the limits that normalised residuals and groups of residuals are held against.

With a known sigma0 a normalised residual w is normal and a group of k residuals chi-square distributed (Baarda 1968).
With sigma0 from the same adjustment w follows the tau distribution (Pope 1976), and a group's statistic, freed of its
own share in sigma0, Fisher's F. The quantiles come from scipy.special; scipy.stats would cost a second to import.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import chdtri, fdtri, ndtri, stdtrit

from orip.arrays import FloatArray


@dataclass(frozen=True, slots=True)
class OutlierTest:
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
        """Return the limit of a normalised residual, or of the largest of several (Bonferroni)."""
        alpha = self.alpha / among
        if self.redundancy is None:
            return float(-ndtri(alpha / 2.0))
        freedom = self.redundancy
        if freedom < 2:
            return float("inf")
        t = float(stdtrit(freedom - 1, 1.0 - alpha / 2.0))
        return float(np.sqrt(freedom) * t / np.sqrt(freedom - 1 + t * t))

    def group_limit(self, size: int) -> float:
        """Return the limit of `group_statistic` for groups of `size` residuals."""
        if self.redundancy is None:
            return float(np.sqrt(chdtri(size, self.alpha)))
        if self.redundancy <= size:
            return float("inf")
        # fdtri takes the probability below the quantile
        return float(np.sqrt(fdtri(size, self.redundancy - size, 1.0 - self.alpha)))

    def group_statistic(self, residuals: FloatArray, cofactor: FloatArray) -> float:
        """Return the root of the test quantity of a group of k residuals.

        Parameters
        ----------
        residuals : array (k,)
            Divided by their a-priori errors.
        cofactor : array (k, k)
            Of these residuals, for sigma0 = 1.

        Returns
        -------
        float
            NaN where the residuals have no redundancy of their own.
        """
        size = len(residuals)
        values = np.linalg.eigvalsh(cofactor)
        if values[0] < 1e-6:
            return float("nan")
        quantity = float(residuals @ np.linalg.solve(cofactor, residuals))
        if self.redundancy is None:
            return float(np.sqrt(quantity))
        left = self.redundancy * self.sigma0**2 - quantity
        freedom = self.redundancy - size
        return float(np.sqrt(quantity / size / (left / freedom))) if left > 0.0 < freedom else float("nan")
