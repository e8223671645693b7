"""Helmert's equations of variance components (1907; Grafarend, Kleusberg, Schaffrin 1980).

With the residuals v of observations divided by their a-priori errors, l, the matrix R of v = -R l is a projection. The
square sum q_i of the residuals of group i has the expectation sum_j H_ij s_j with H_ij = tr(R_ij R_ji), where the s_j
are the variances of the groups. H s = q gives the estimates; as R is a projection, the rows of H add up to the
redundancies r_i. Repeated with the new errors until all s are 1, they are those of restricted maximum likelihood, whose
covariance is 2 H^-1 there.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from msgspec import Struct
from scipy.special import erf

from orip.adjustment.residual_sums import residual_sums
from orip.arrays import BoolArray, FloatArray, IntArray
from orip.bundle.groups.ground_rows import rows_under_test
from orip.bundle.solve import SolvedBlock
from orip.bundle.variance_components.variance_groups import GroupRows

_MOST_EXACT = 600
"""Observations on the ground of which all pairs are taken; groups of more count as if independent of each other."""

_SMALL = 1e-12

_MOST_STEP = 2.0
"""Of the logarithm of a variance; far from the solution the equations are no more than a direction."""

_LEAST_SEPARATION = 1e-3
"""Smallest eigenvalue of H scaled to a unit diagonal, below which two groups cannot be told apart."""


class VarianceEquations(Struct, frozen=True):
    """Helmert's equations of g groups.

    Parameters
    ----------
    square_sum : array (g,)
        q.
    redundancy : array (g,)
    matrix : array (g, g)
        H.
    """

    square_sum: FloatArray
    redundancy: FloatArray
    matrix: FloatArray

    def estimable(self, least_redundancy: float) -> BoolArray:
        """Return the groups (g,) with so much redundancy that can be told from each other.

        Of those that cannot be told apart the one with the least redundancy is left out.
        """
        found = self.redundancy >= least_redundancy
        while found.sum() > 1:
            rows = np.flatnonzero(found)
            scale = 1.0 / np.sqrt(np.diag(self.matrix)[rows])
            values, vectors = np.linalg.eigh(self.matrix[np.ix_(rows, rows)] * np.outer(scale, scale))
            if values[0] > _LEAST_SEPARATION:
                break
            alike = rows[np.abs(vectors[:, 0]) > 0.5 * np.abs(vectors[:, 0]).max()]
            found[alike[np.argmin(self.redundancy[alike])]] = False
        return found

    def changes(self, estimated: BoolArray) -> FloatArray:
        """Return the factors (g,) to multiply the variances by; 1 for groups that are not estimated.

        They are exp(H^-1 (q - r)), Fisher's scoring for the logarithms of the variances: to first order Helmert's
        estimates, and never negative.
        """
        rows = np.flatnonzero(estimated)
        result = np.ones(len(estimated))
        excess = self.square_sum[rows] - self.redundancy[rows]
        steps = np.linalg.solve(self.matrix[np.ix_(rows, rows)], excess)
        result[rows] = np.exp(np.clip(steps, -_MOST_STEP, _MOST_STEP))
        return result

    def cofactors(self, estimated: BoolArray) -> FloatArray:
        """Return the diagonal (g,) of H^-1 for variances of 1; NaN for groups that are not estimated."""
        rows = np.flatnonzero(estimated)
        result = np.full(len(estimated), np.nan)
        result[rows] = np.diag(np.linalg.inv(self.matrix[np.ix_(rows, rows)]))
        return result


def variance_equations(solved: SolvedBlock, groups: Sequence[GroupRows], limit: float = np.inf) -> VarianceEquations:
    """Return Helmert's equations of an adjusted block.

    H is exact for one camera. Of several cameras, what a group on the ground shares with the photo points is divided
    among them by their numbers, and they count as independent of each other.

    Parameters
    ----------
    solved : SolvedBlock
    groups : sequence of GroupRows
        With the observations of full weight alone.
    limit : float
        Standard residual above which observations have lost weight.
    """
    numbers, residual = solved.variance.redundancy_numbers, solved.equations.residual
    redundancy = np.array([float(np.sum(numbers[group.rows])) for group in groups])
    square_sum = np.array([float(np.sum(residual[group.rows] ** 2)) for group in groups])
    square_sum *= _lost_tails(solved, groups, redundancy, limit)
    of_photos = np.array([group.group.kind == "photo" for group in groups], dtype=bool)
    matrix = np.zeros((len(groups), len(groups)))
    ground = np.flatnonzero(~of_photos)
    matrix[np.ix_(ground, ground)] = _pairs(
        solved, [groups[place].rows for place in ground.tolist()], redundancy[ground]
    )
    photos = np.flatnonzero(of_photos)
    if len(photos):
        shares = np.array([float(len(groups[place].rows)) for place in photos.tolist()])
        common = np.maximum(redundancy[ground] - matrix[np.ix_(ground, ground)].sum(axis=1), 0.0)
        crossing = np.outer(shares / max(shares.sum(), 1.0), common)
        matrix[np.ix_(photos, ground)], matrix[np.ix_(ground, photos)] = crossing, crossing.T
        matrix[photos, photos] = redundancy[photos] - crossing.sum(axis=1)
    return VarianceEquations(square_sum, redundancy, matrix)


def _lost_tails(solved: SolvedBlock, groups: Sequence[GroupRows], redundancy: FloatArray, limit: float) -> FloatArray:
    """Return by what (g,) square sums are too small because larger residuals have lost weight, and do not count.

    A normal residual with redundancy number r has the variance r (1 - 2 c f(c) / (2 F(c) - 1)) as long as it is below
    the limit c sqrt(r) of the Danish method, with the density f and the distribution F of the normal distribution.
    """
    result = np.ones(len(groups))
    if not np.isfinite(limit):
        return result
    for place, group in enumerate(groups):
        numbers = np.maximum(solved.variance.redundancy_numbers[group.rows], 0.0)
        c = limit / np.sqrt(np.maximum(numbers, _SMALL))
        inside = np.sum(numbers * (1.0 - np.sqrt(2.0 / np.pi) * c * np.exp(-(c**2) / 2.0) / erf(c / np.sqrt(2.0))))
        if inside > 0.0:
            result[place] = redundancy[place] / inside
    return result


def _pairs(solved: SolvedBlock, rows: Sequence[IntArray], redundancy: FloatArray) -> FloatArray:
    """Return H (g, g) of groups on the ground."""
    every = np.concatenate([np.zeros(0, dtype=np.int64), *rows])
    if not len(every) or len(every) > _MOST_EXACT:
        return np.diag(redundancy)
    tested = rows_under_test(solved, every, np.ones(len(every)))
    squares = (np.eye(len(every)) - residual_sums(tested, np.eye(len(every))).smoothed) ** 2
    member = np.zeros((len(every), len(rows)))
    member[np.arange(len(every)), np.repeat(np.arange(len(rows)), [len(part) for part in rows])] = 1.0
    return np.asarray(member.T @ squares @ member)
