"""Weighted sums of residuals with their covariances, for tests of groups of observations.

With the design matrix A, H = A Q A^T and weight factors W the residuals are v = (H W - I) l, and so they are
correlated: a sum c^T v of many residuals of one group may vary far less, or far more, than as many independent ones
would. The covariances are exact where weight factors are 0 or 1; observations that are not among the tested rows and
have lost a part of their weight make them slightly too large.

All rows are divided by their a-priori errors. Check observations, which had no influence, are rows with weight 0: their
residuals have the covariance I + H.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from msgspec import Struct
from scipy.sparse import csr_array

from orip.arrays import BoolArray, FloatArray
from orip.structs import replace

_AT_ONCE = 60
"""Right-hand sides that are solved together: limits memory, as each has as many elements as there are unknowns."""


class RowsUnderTest(Struct, frozen=True):
    """k observation equations at the solution, divided by their a-priori errors.

    Parameters
    ----------
    design : csr_array (k, u)
        By the unknowns that the rows depend on.
    residual : array (k,)
        Adjusted minus observed.
    weight : array (k,)
        Weight factors; 0 for check observations.
    solve : callable
        Returns Q times right-hand sides (u, j), for sigma0 = 1.
    others_variance : float
        Variance factor of all observations that are not among these rows; these have 1.
    """

    design: csr_array
    residual: FloatArray
    weight: FloatArray
    solve: Callable[[FloatArray], FloatArray]
    others_variance: float = 1.0


class ResidualSums(Struct, frozen=True):
    """j sums C^T v of residuals.

    Parameters
    ----------
    rows : RowsUnderTest
    factors : array (k, j)
        C.
    smoothed : array (k, j)
        H C.
    """

    rows: RowsUnderTest
    factors: FloatArray
    smoothed: FloatArray

    @property
    def values(self) -> FloatArray:
        """Return C^T v (j,)."""
        return np.asarray(self.factors.T @ self.rows.residual)

    def covariance(self) -> FloatArray:
        """Return the covariance (j, j) of the sums."""
        c, y, w = self.factors, self.smoothed, self.rows.weight[:, None]
        # H W² H = H - H W (I - W) H, as H W H = H
        cross = (w * c).T @ y
        every = c.T @ c - cross - cross.T + c.T @ y - y.T @ (w * (1.0 - w) * y)
        own = w * y - c
        of_these = own.T @ own
        return np.asarray(of_these + self.rows.others_variance * (every - of_these))

    def response(self, error: FloatArray) -> FloatArray:
        """Return by how much the sums (j,) decrease when the observations have errors (k,)."""
        return np.asarray(self.factors.T @ error - self.smoothed.T @ (self.rows.weight * error))


def residual_sums(rows: RowsUnderTest, factors: FloatArray) -> ResidualSums:
    """Return sums of residuals: the columns of `factors` (k, j)."""
    count = factors.shape[1]
    parts = [_smoothed(rows, factors[:, at : at + _AT_ONCE]) for at in range(0, count, _AT_ONCE)]
    return ResidualSums(rows, factors, np.hstack(parts) if parts else factors)


def with_checks_used(sums: ResidualSums, checks: BoolArray, smoothed_checks: FloatArray) -> ResidualSums:
    """Return the sums after an adjustment in which the check observations take part, without iterating again.

    Parameters
    ----------
    sums : ResidualSums
    checks : array (k,) of bool
        The check observations, c of them.
    smoothed_checks : array (k, c)
        H times their unit vectors.
    """
    gain = np.linalg.solve((np.eye(smoothed_checks.shape[1]) + smoothed_checks[checks]).T, smoothed_checks.T).T
    rows = replace(
        sums.rows,
        residual=sums.rows.residual - gain @ sums.rows.residual[checks],
        weight=np.where(checks, 1.0, sums.rows.weight),
    )
    return ResidualSums(rows, sums.factors, sums.smoothed - gain @ sums.smoothed[checks])


def _smoothed(rows: RowsUnderTest, factors: FloatArray) -> FloatArray:
    return np.asarray(rows.design @ rows.solve(np.asarray(rows.design.T @ factors)))
