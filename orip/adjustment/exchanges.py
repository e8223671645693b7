"""Whether the robust cost is lower if other observations lose their weight."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from orip.adjustment.equations import Equations, Layout
from orip.adjustment.normals import SolvedNormals
from orip.adjustment.residual_sums import factored_rows
from orip.adjustment.weight_changes import ORDINARY, LinearAdjustment, Thresholds
from orip.adjustment.weight_search import MOST_ROUNDS, weights_of_lower_cost
from orip.arrays import BoolArray, FloatArray, IntArray

# A gross error pulls its neighbours along, and where the iterations begin decides which of them is the first to lose
# weight. The solution is a local minimum of the robust cost then: none of its observations fits with full weight, and
# yet the cost is lower with another one down-weighted in its place. Here such exchanges are tried without an adjustment
# (`weight_search`), and then with the linearisation of the solution.

_MOST_ROWS, _MOST_REDUCED = 1000, 60
"""Up to 1000 observations are all tried, beyond that only those of doubtful points. No exchange is tried once more than
60 are down-weighted: the outcome would depend on the start."""

_NEAR = 0.7
"""Part of the limit above which a residual puts its point in doubt: without weight it would be larger."""

_CLOSE = 2.0
"""Part of the limit up to which observations are tried where many have lost weight: they may fit with full weight."""

_FEW, _MOST_PART = 12, 0.1
"""Observations that may have lost weight, and their part of all: more are not wrong one by one, but with a photo."""

_SHARED = 0.03
"""Part of an error that has to appear in another observation, for which it may be mistaken."""

_MOST_RELATED = 500
"""Observations that are tried together with those that have lost weight: of more those with the largest residuals. The
search takes the square of their number."""

_AT_ONCE = 500
"""Rows of which leverages are computed together."""


class Exchange(NamedTuple):
    """Observations that get full weight, and others that lose theirs: an adjustment with its normal equations updated.

    With H = A_i N^-1 A_i^T for the observations i whose weights change by D, the normal equations N + A_i^T D A_i are
    solved by N^-1 - N^-1 A_i^T (D^-1 + H)^-1 A_i N^-1 (Sherman, Morrison and Woodbury).

    Attributes
    ----------
    full_weight, no_weight : arrays of int
    changed : array (k,) of int
        Observations i.
    change : array (k,)
        D.
    cofactor : array (k, k)
        H.
    """

    full_weight: IntArray
    no_weight: IntArray
    changed: IntArray
    change: FloatArray
    cofactor: FloatArray

    def correction(
        self, residual: FloatArray, equations: Equations, weights: FloatArray, normals: SolvedNormals
    ) -> FloatArray:
        """Return the correction (m + 3 b,) of an adjustment with the changed weights, from residuals (n,).

        `equations` have the design matrix of the normal equations, whose weights (n,) are given, `normals` their
        constraints.
        """
        weighted = equations.effective(weights) * residual
        weighted[self.changed] += self.change * residual[self.changed]
        before = normals.solve((equations.design.T @ weighted)[:, None])[:, 0]
        chosen = equations.design[self.changed]
        pull = np.linalg.solve(np.diag(1.0 / self.change) + self.cofactor, chosen @ before)
        return np.asarray(normals.solve((chosen.T @ pull)[:, None])[:, 0] - before)


def are_few(equations: Equations, weights: FloatArray) -> bool:
    """Return whether so few observations have lost weight that all of them can be tried, and are wrong one by one."""
    return _are_few(weights[equations.active & ~equations.exact])


def wrong_one_by_one(equations: Equations, weights: FloatArray, limit: float) -> BoolArray:
    """Return the observations (n,) among which few have lost weight: all, or those close to the limit, or none.

    What has lost weight with a residual of many times the limit is wrong, however many there are.
    """
    judged = equations.active & ~equations.exact
    if not _are_few(weights[judged]):
        judged &= np.abs(equations.residual) < _CLOSE * limit
    return judged if _are_few(weights[judged]) else np.zeros_like(judged)


def wrong_by_themselves(equations: Equations, weights: FloatArray) -> BoolArray:
    """Return the observations (n,) of no wider group, as those of control points, if few of them have lost weight.

    Where many photo points do not fit, a control point may be wrong by itself.
    """
    judged = equations.active & ~equations.exact
    if (groups := equations.wider_groups()) is not None:
        judged &= groups < 0
    return judged if _are_few(weights[judged]) else np.zeros_like(judged)


def lost_by_themselves(equations: Equations, weights: FloatArray, layout: Layout, among: BoolArray) -> IntArray:
    """Return the observations (k,) that have lost weight and are `among` some (n,), or concern no eliminated point.

    The latter are photo points of control points without errors: where all of them have lost weight, the control point
    has, though no observation is its own. None are returned where there are many.
    """
    lost = np.flatnonzero(equations.active & ~equations.exact & (weights < 1.0))
    of_no_point = np.diff(equations.rows.some(lost)[:, layout.reduced :].indptr) == 0
    found = lost[among[lost] | of_no_point]
    return np.asarray(found if len(found) <= _MOST_REDUCED else found[:0])


def _are_few(weights: FloatArray) -> bool:
    return bool(np.count_nonzero(weights < 1.0) <= min(max(_FEW, _MOST_PART * len(weights)), _MOST_REDUCED))


def exchanges_to_try(
    equations: Equations,
    weights: FloatArray,
    normals: SolvedNormals,
    layout: Layout,
    limit: float,
    among: BoolArray,
    rounds: int = MOST_ROUNDS,
    thresholds: Thresholds = ORDINARY,
) -> tuple[Exchange, ...]:
    """Return exchanges that lower the robust cost of a converged solution, or may lower it, the most promising first.

    Parameters
    ----------
    equations : Equations
    weights : array (n,)
    normals : SolvedNormals
        With these weights, and their constraints.
    layout : Layout
    limit : float
        Standard residual up to which an observation has full weight.
    among : array (n,) of bool
        Observations that may be exchanged.
    rounds : int
    thresholds : Thresholds
    """
    rows = _rows_to_exchange(equations, weights, layout, limit, among)
    is_large = _are_large(equations, weights, normals, layout, rows, limit, thresholds)
    related = _related(equations, weights, normals, rows)
    others = np.flatnonzero(is_large & ~related)
    size = np.abs(equations.residual[rows[others]])
    most = max(_MOST_RELATED - np.count_nonzero(related), 0)
    related[others[np.argsort(-size, kind="stable")[:most]]] = True
    rows = rows[related]
    cofactor = factored_rows(equations, weights, normals, layout, rows).cofactor()
    # the residuals after one more correction with the same normal equations
    weighted = equations.effective(weights) * equations.residual
    right = equations.design.T @ weighted
    correction = normals.solve(right[:, None])[:, 0]
    residual = equations.residual[rows] - equations.design[rows] @ correction
    square_sum = float(weighted @ np.where(equations.active, equations.residual, 0.0) - right @ correction)
    weight = weights[rows]
    start = LinearAdjustment(cofactor, residual, weight, square_sum, thresholds)
    ends = weights_of_lower_cost(start, limit, rounds)
    return tuple(_exchange(weight, end, rows, cofactor, equations) for end in ends)


def _exchange(
    before: FloatArray, after: FloatArray, rows: IntArray, cofactor: FloatArray, equations: Equations
) -> Exchange:
    """Return the exchange that changes the weights (c,) of some observations with cofactors (c, c)."""
    full = _with_their_groups(rows[(before < 1.0) & (after >= 1.0)], equations)
    none = np.setdiff1d(_with_their_groups(rows[(after < 1.0) & (before >= 1.0)], equations), full)
    places = np.flatnonzero(after != before)
    return Exchange(full, none, rows[places], (after - before)[places], cofactor[np.ix_(places, places)])


def _with_their_groups(rows: IntArray, equations: Equations) -> IntArray:
    """Return observations with those that lose weight together with them."""
    if equations.groups is None:
        return rows
    groups = equations.groups[rows]
    return np.union1d(rows, np.flatnonzero(np.isin(equations.groups, groups[groups >= 0]) & equations.active))


def _rows_to_exchange(
    equations: Equations, weights: FloatArray, layout: Layout, limit: float, among: BoolArray
) -> IntArray:
    """Return the observations that may be exchanged: all, or of many those of points that have lost some, or nearly."""
    judged = np.flatnonzero(among)
    if len(judged) <= _MOST_ROWS:
        return judged
    points = equations.design[:, layout.reduced :]
    nearly_wrong = np.abs(equations.residual[judged]) > _NEAR * limit
    doubtful = judged[(weights[judged] < 1.0) | nearly_wrong]
    touched = np.unique(points[doubtful].indices // 3)
    columns = (3 * touched[:, None] + np.arange(3)).ravel()
    beside = np.diff(points[judged][:, columns].tocsr().indptr) > 0
    return np.union1d(doubtful, judged[beside])


def _are_large(
    equations: Equations, weights: FloatArray, normals: SolvedNormals, layout: Layout, rows: IntArray, limit: float,
    thresholds: Thresholds,
) -> BoolArray:  # fmt: skip
    """Return which observations (c,) have residuals with which they may lose their weight."""
    size = np.abs(equations.residual[rows])
    least, most = thresholds.residuals(np.array([0.0, 1.0]), limit)
    is_large = np.asarray(size > most)
    # in between it depends on the leverage
    places = np.flatnonzero((size > least) & ~is_large)
    for some in (places[first : first + _AT_ONCE] for first in range(0, len(places), _AT_ONCE)):
        leverage = factored_rows(equations, weights, normals, layout, rows[some]).leverages()
        is_large[some] = size[some] > thresholds.residuals(1.0 - weights[rows[some]] * leverage, limit)
    return is_large


def _related(equations: Equations, weights: FloatArray, normals: SolvedNormals, rows: IntArray) -> BoolArray:
    """Return which observations (c,) have lost weight, or share an error with one that has."""
    weight = weights[rows]
    reduced = weight < 1.0
    chosen = equations.design[rows]
    columns = np.unique(chosen.indices)
    chosen = chosen[:, columns]
    cofactor = chosen @ normals.solve_at(columns, chosen[reduced].toarray().T)
    leverage = np.diag(cofactor[reduced])
    # the part of an error of the reduced observation, taken back, that appears in the other one
    shared = np.abs(cofactor) / (1.0 + (1.0 - weight[reduced]) * leverage)
    return np.asarray(reduced | (shared.max(axis=1, initial=0.0) > _SHARED))
