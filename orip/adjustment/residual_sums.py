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

from orip.arrays import BoolArray, FloatArray, IntArray
from orip.structs import replace

_AT_ONCE = 60
"""Right-hand sides that are solved together: limits memory, as each has as many elements as there are unknowns."""


class RowsUnderTest(Struct, frozen=True):
    """k observation equations at the solution, divided by their a-priori errors.

    Parameters
    ----------
    design : csr_array (k, c)
        By the unknowns that the rows depend on.
    columns : array (c,) of int
        These unknowns, among all.
    residual : array (k,)
        Adjusted minus observed.
    weight : array (k,)
        Weight factors; 0 for check observations.
    solve : callable
        Returns Q times right-hand sides (c, j), for sigma0 = 1.
    others_variance : float
        Variance factor of all observations that are not among these rows; these have 1.
    """

    design: csr_array
    columns: IntArray
    residual: FloatArray
    weight: FloatArray
    solve: Callable[[FloatArray], FloatArray]
    others_variance: float = 1.0


class HeldParameters(Struct, frozen=True):
    """m parameters that are held although they act on other rows: P is what one unit of each changes there.

    Their sums are P^T W v over these rows, whose weights W are taken to be 0 or 1.

    Parameters
    ----------
    values : array (m,)
        P^T W v.
    square : array (m, m)
        P^T W P.
    right : array (u, m)
        A^T W P, by all unknowns.
    moved : array (u, m)
        Q A^T W P.
    """

    values: FloatArray
    square: FloatArray
    right: FloatArray
    moved: FloatArray


class Outside(Struct, frozen=True):
    """The part of j sums that comes from rows that are not under test; zeros where there is none.

    Parameters
    ----------
    values : array (j,)
    square, smoothed : arrays (j, j)
        C^T C and C^T H C over these rows, the latter with H times the whole of the second sum.
    """

    values: FloatArray
    square: FloatArray
    smoothed: FloatArray


class ResidualSums(Struct, frozen=True):
    """j sums C^T v of residuals.

    Parameters
    ----------
    rows : RowsUnderTest
    factors : array (k, j)
        C.
    smoothed : array (k, j)
        H C.
    outside : Outside or None
        What the sums of held parameters have; None: there are none.
    """

    rows: RowsUnderTest
    factors: FloatArray
    smoothed: FloatArray
    outside: Outside | None = None

    @property
    def values(self) -> FloatArray:
        """Return C^T v (j,)."""
        found = np.asarray(self.factors.T @ self.rows.residual)
        return found if self.outside is None else found + self.outside.values

    @property
    def most(self) -> FloatArray:
        """Return the variances (j,) of as many independent residuals."""
        found = np.sum(self.factors**2, axis=0)
        return np.asarray(found if self.outside is None else found + np.diag(self.outside.square))

    def covariance(self) -> FloatArray:
        """Return the covariance (j, j) of the sums."""
        c, y, w = self.factors, self.smoothed, self.rows.weight[:, None]
        # H W² H = H - H W (I - W) H, as H W H = H
        cross, own_square, smoothed = (w * c).T @ y, c.T @ c, c.T @ y
        if self.outside is not None:
            cross, smoothed = cross + self.outside.smoothed, smoothed + self.outside.smoothed
            own_square = own_square + self.outside.square
        every = own_square - cross - cross.T + smoothed - y.T @ (w * (1.0 - w) * y)
        own = w * y - c
        of_these = own.T @ own
        return np.asarray(of_these + self.rows.others_variance * (every - of_these))

    def responses(self, errors: FloatArray) -> FloatArray:
        """Return by how much the sums (j,) decrease when the observations have errors (k, e): an array (j, e).

        With as many errors as sums, those of the held parameters are of one unit of them.
        """
        found = self.factors.T @ errors - self.smoothed.T @ (self.rows.weight[:, None] * errors)
        if self.outside is not None:
            found = found + self.outside.square - self.outside.smoothed.T
        return np.asarray(found)


def residual_sums(rows: RowsUnderTest, factors: FloatArray, held: HeldParameters | None = None) -> ResidualSums:
    """Return sums of residuals: the columns of `factors` (k, j), then those of held parameters."""
    count = factors.shape[1]
    parts = [_smoothed(rows, factors[:, at : at + _AT_ONCE]) for at in range(0, count, _AT_ONCE)]
    found = ResidualSums(rows, factors, np.hstack(parts) if parts else factors)
    return found if held is None or not len(held.values) else _with_held(found, held)


def _with_held(sums: ResidualSums, held: HeldParameters) -> ResidualSums:
    """Return sums with those of held parameters, which have no factors in the rows under test."""
    count, more = sums.factors.shape[1], len(held.values)
    smoothed = sums.rows.design @ held.moved[sums.rows.columns]
    square, outside = np.zeros((count + more,) * 2), np.zeros((count + more,) * 2)
    square[count:, count:] = held.square
    outside[count:, :count] = smoothed.T @ sums.factors
    outside[count:, count:] = held.right.T @ held.moved
    return ResidualSums(
        sums.rows,
        np.hstack([sums.factors, np.zeros((len(sums.factors), more))]),
        np.hstack([sums.smoothed, smoothed]),
        Outside(np.concatenate([np.zeros(count), held.values]), square, outside),
    )


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
    own = np.eye(smoothed_checks.shape[1]) + smoothed_checks[checks]
    gain = np.linalg.solve(own.T, smoothed_checks.T).T
    rows = replace(
        sums.rows,
        residual=sums.rows.residual - gain @ sums.rows.residual[checks],
        weight=np.where(checks, 1.0, sums.rows.weight),
    )
    outside = sums.outside
    if outside is not None:
        is_held = np.diag(outside.square) > 0.0
        of_held = np.where(is_held, np.linalg.solve(own, sums.smoothed[checks]), 0.0).T
        outside = replace(
            outside,
            values=outside.values - of_held @ sums.rows.residual[checks],
            smoothed=outside.smoothed - of_held @ sums.smoothed[checks],
        )
    return ResidualSums(rows, sums.factors, sums.smoothed - gain @ sums.smoothed[checks], outside)


def _smoothed(rows: RowsUnderTest, factors: FloatArray) -> FloatArray:
    return np.asarray(rows.design @ rows.solve(np.asarray(rows.design.T @ factors)))
