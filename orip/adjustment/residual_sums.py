"""How chosen observations act on each other, and weighted sums of residuals with their covariances."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from msgspec import Struct
from scipy.sparse import csr_array

from orip.adjustment.equations import Equations, Layout
from orip.adjustment.factorisation.elimination import block_diagonal
from orip.adjustment.normals import SolvedNormals
from orip.arrays import BoolArray, FloatArray, IntArray
from orip.structs import replace

# With the design matrix A, H = A Q A^T and weight factors W the residuals are v = (H W - I) l, and so they are
# correlated: a sum c^T v of many residuals of one group may vary far less, or far more, than as many independent ones
# would. The covariances are exact where weight factors are 0 or 1; observations that are not among the tested rows and
# have lost a part of their weight make them slightly too large.
#
# All rows are divided by their a-priori errors. Check observations, which had no influence, are rows with weight 0:
# their residuals have the covariance I + H.

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


# With residuals v and cofactors H = A Q A^T of the adjusted observations, all divided by a-priori errors, leaving out
# the observations i changes the residuals of all others, j, by H_ji (I - H_ii)^-1 v_i, and the cofactors by H_ji (I -
# H_ii)^-1 H_ij; taking them back by -H_ji (I + H_ii)^-1 v_i and -H_ji (I + H_ii)^-1 H_ij. The weighted square sum falls
# by v_i^T (I - H_ii)^-1 v_i, or rises by v_i^T (I + H_ii)^-1 v_i. Exact where the observations are linear.

TESTABLE = 1e-4
"""Part of an error that must show in the residuals; where less does, the observation is not checked by others."""


class SquareSumChange(NamedTuple):
    """The change of the weighted square sum by each of u groups, array (u,), on `freedom` (u,) checked combinations."""

    change: FloatArray
    freedom: IntArray


class JointEffects(Struct, frozen=True):
    """Observations of an adjusted problem, and how they act on each other.

    Parameters
    ----------
    residual : array (c,)
        Divided by the a-priori errors.
    cofactor : array (c, c)
        Of the adjusted observations, for sigma0 = 1 and likewise divided.
    in_use : array (c,) of bool
        False: left out.
    """

    residual: FloatArray
    cofactor: FloatArray
    in_use: BoolArray

    def normalised(self) -> FloatArray:
        """Return |residual| over its standard deviation (c,) for sigma0 = 1; NaN where nothing checks it."""
        leverage = np.diag(self.cofactor)
        variance = np.where(self.in_use, 1.0 - leverage, 1.0 + leverage)
        checked = variance > TESTABLE
        return np.where(checked, np.abs(self.residual) / np.sqrt(np.where(checked, variance, 1.0)), np.nan)

    def square_sum_changes(self, groups: IntArray) -> SquareSumChange:
        """Return by how much the square sum falls when a group is left out, or rises when it is taken back.

        Parameters
        ----------
        groups : array (u, k) of int
            Places of the observations of each group, which are all in use or all left out.
        """
        values, vectors = np.linalg.eigh(self._of_residuals(groups))
        checked = values > TESTABLE
        along = np.einsum("uji,uj->ui", vectors, self.residual[groups])
        change = np.where(checked, along**2 / np.where(checked, values, 1.0), 0.0).sum(axis=1)
        return SquareSumChange(change, checked.sum(axis=1))

    def unchecked(self, group: IntArray) -> bool:
        """Return whether observations in use (k,) have a combination that no other observation checks."""
        return bool(np.linalg.eigvalsh(self._of_residuals(group[None])[0])[0] <= TESTABLE)

    def changed(self, group: IntArray) -> JointEffects:
        """Return the observations after those of a group (k,) are left out, or taken back if they were."""
        used = bool(self.in_use[group[0]])
        sign = 1.0 if used else -1.0
        values, vectors = np.linalg.eigh(self._of_residuals(group[None])[0])
        # a combination that no other observation checks has no influence on the others
        checked = values > TESTABLE
        effect = self.cofactor[:, group] @ vectors[:, checked] / np.sqrt(values[checked])
        along = vectors[:, checked].T @ self.residual[group] / np.sqrt(values[checked])
        in_use = self.in_use.copy()
        in_use[group] = not used
        return JointEffects(self.residual + sign * effect @ along, self.cofactor + sign * effect @ effect.T, in_use)

    def _of_residuals(self, groups: IntArray) -> FloatArray:
        """Return the cofactors (u, k, k) of the residuals of groups (u, k)."""
        own = self.cofactor[groups[:, :, None], groups[:, None, :]]
        sign = np.where(self.in_use[groups[:, 0]], -1.0, 1.0)
        return np.asarray(np.eye(groups.shape[1]) + sign[:, None, None] * own)


class FactoredRows(Struct, frozen=True):
    """Rows W of observations with cofactors W W^T - B B^T, from the factor of the normal equations.

    Parameters
    ----------
    of_reduced : array (m', c)
        L^-1 of the rows freed of their points, with the factor L of the reduced system.
    of_points : sparse array (c, 3 p)
        For the p points that the rows touch.
    bound : array (c, q)
        B: what exact constraints determine.
    """

    of_reduced: FloatArray
    of_points: csr_array
    bound: FloatArray

    def cofactor(self) -> FloatArray:
        """Return the cofactors (c, c) of the adjusted observations with each other."""
        of_points = (self.of_points @ self.of_points.T).toarray()
        return np.asarray(of_points + self.of_reduced.T @ self.of_reduced - self.bound @ self.bound.T)

    def leverages(self) -> FloatArray:
        """Return the diagonal (c,) of the cofactors."""
        squares = [
            np.einsum("ij,ij->j", self.of_reduced, self.of_reduced),
            np.einsum("ij,ij->i", self.bound, self.bound),
        ]
        return np.asarray(self.of_points.multiply(self.of_points).sum(axis=1) + squares[0] - squares[1])

    def of(self, places: IntArray) -> FactoredRows:
        """Return some of the rows."""
        return FactoredRows(self.of_reduced[:, places], self.of_points[places], self.bound[places])


def factored_rows(
    equations: Equations, weights: FloatArray, normals: SolvedNormals, layout: Layout, rows: IntArray
) -> FactoredRows:
    """Return W and B of observations.

    Parameters
    ----------
    equations : Equations
        At a solution.
    weights : array (n,)
        Weight factors of the normal equations; those of observations that are not in use do not count.
    rows : array (c,) of int
        Their numbers among all rows.
    """
    freed, of_points = _freed_of_points(equations, weights, normals, layout, rows)
    of_reduced = normals.factor.reduce(freed.toarray().T / normals.scale[:, None])
    constraints = normals.constraints
    if constraints is None:
        return FactoredRows(of_reduced, of_points, np.zeros((len(rows), 0)))
    values, vectors = np.linalg.eigh(constraints.inverse)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    return FactoredRows(of_reduced, of_points, equations.design[rows] @ (constraints.spread @ root))


def joint_effects(equations: Equations, normals: SolvedNormals, layout: Layout, rows: IntArray) -> JointEffects:
    """Return how observations act on each other at a solution in which those in use have full weight."""
    cofactor = factored_rows(equations, np.ones(len(equations.residual)), normals, layout, rows).cofactor()
    return JointEffects(equations.residual[rows], cofactor, equations.active[rows])


def _freed_of_points(
    equations: Equations, weights: FloatArray, normals: SolvedNormals, layout: Layout, rows: IntArray
) -> tuple[csr_array, csr_array]:
    """Return a_r - a_p H^T B (c, m) and a_p H^T (c, 3 p) of rows a, with the points' rows B of the factor.

    B is formed for the p points that these rows touch.
    """
    design, m = equations.design, layout.reduced
    chosen = design[rows]
    in_points = chosen[:, m:].tocsr()
    points = np.unique(in_points.indices // 3)
    columns = (3 * points[:, None] + np.arange(3)).ravel()
    half = block_diagonal(normals.blocks.half[points])
    along = (in_points[:, columns] @ half.T).tocsr()
    touching = design[:, m + columns].tocsr()
    at_points = np.flatnonzero((np.diff(touching.indptr) > 0) & equations.active)
    weighted = touching[at_points].multiply(weights[at_points, None]).tocsr()
    rows_of_factor = half @ (weighted.T @ design[at_points][:, :m])
    return (chosen[:, :m] - along @ rows_of_factor).tocsr(), along
