"""How chosen observations act on each other: what follows when some are left out or taken back, without an adjustment.

With residuals v and cofactors H = A Q A^T of the adjusted observations, all divided by a-priori errors, leaving out the
observations i changes the residuals of all others, j, by H_ji (I - H_ii)^-1 v_i, and the cofactors by
H_ji (I - H_ii)^-1 H_ij; taking them back by -H_ji (I + H_ii)^-1 v_i and -H_ji (I + H_ii)^-1 H_ij. The weighted square
sum falls by v_i^T (I - H_ii)^-1 v_i, or rises by v_i^T (I + H_ii)^-1 v_i. Exact where the observations are linear.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from msgspec import Struct
from scipy.sparse import csr_array

from orip.adjustment.equations import Equations, Layout
from orip.adjustment.factorisation.elimination import block_diagonal
from orip.adjustment.normals import SolvedNormals
from orip.arrays import BoolArray, FloatArray, IntArray

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
    normals : SolvedNormals
    layout : Layout
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
