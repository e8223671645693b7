"""Exchanges: whether the robust cost is lower if other observations are the ones that lose their weight.

A gross error pulls its neighbours along, and where the iterations begin decides which of them is the first to lose
weight. The solution is a local minimum of the robust cost then: none of its observations fits with full weight, and yet
the cost is lower with another one down-weighted in its place. Here such exchanges are tried without an adjustment. With
cofactors H = A Q A^T of the adjusted observations, a change d of the weight of observation i changes the residuals by
-H_i g v_i with g = d / (1 + d h_i), the cofactors by -g H_i H_i^T and the weighted square sum by g v_i^2. That is exact
where the observations are linear.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from operator import itemgetter
from typing import NamedTuple

import numpy as np

from orip.adjustment.equations import Equations, Layout
from orip.adjustment.joint_effects import factored_rows
from orip.adjustment.normals import SolvedNormals
from orip.adjustment.weights import danish_costs
from orip.arrays import BoolArray, FloatArray, IntArray

_MOST_ROWS, _MOST_REDUCED = 1000, 20
"""Observations that are all tried; of more, so many that have lost weight, with the others of their points."""

_MOST_TAKEN_BACK = 60
"""Observations that are taken back for trial: of more, those with the smallest residuals."""

_FEW, _MOST_PART = 12, 0.1
"""Observations that may have lost weight, and their part of all: more are not wrong one by one, but with a photo."""

_LEAST_GAIN, _DOUBT = 0.002, 0.01
"""Part of the square of the limit by which the cost has to fall; exchanges after which it is higher by no more than the
second are doubtful: residuals of dozens of a-priori errors are not linear, and only an adjustment tells."""

_MOST_FOUND = 8
"""Exchanges that are looked at without the linearisation, at one solution."""

_SHARED = 0.03
"""Part of an error that has to appear in another observation, for which it may be mistaken."""

_ALTERNATIVES = 4
_LONGEST = 12
_ROUNDS = 5
_TESTABLE = 0.03
"""Least redundancy number of an observation that may lose its weight."""


class Exchange(NamedTuple):
    """Observations that get full weight, and others that lose theirs: an adjustment with its normal equations updated.

    With Z = N^-1 A_i^T for the observations i whose weights change by D, the normal equations N + A_i^T D A_i are
    solved by N^-1 - Z (D^-1 + A_i Z)^-1 Z^T (Sherman, Morrison and Woodbury).

    Attributes
    ----------
    full_weight, no_weight : arrays of int
    changed : array (k,) of int
        Observations i.
    change : array (k,)
        D.
    spread : array (m + 3 b, k)
        Z.
    """

    full_weight: IntArray
    no_weight: IntArray
    changed: IntArray
    change: FloatArray
    spread: FloatArray

    def correction(
        self, residual: FloatArray, equations: Equations, weights: FloatArray, normals: SolvedNormals
    ) -> FloatArray:
        """Return the correction (m + 3 b,) of an adjustment with the changed weights, from residuals (n,).

        Parameters
        ----------
        residual : array (n,)
        equations : Equations
            With the design matrix of the normal equations.
        weights : array (n,)
            Of the normal equations.
        normals : SolvedNormals
            With their constraints.
        """
        weighted = np.where(equations.active, weights, 0.0) * residual
        weighted[self.changed] += self.change * residual[self.changed]
        before = normals.solve((equations.design.T @ weighted)[:, None])[:, 0]
        chosen = equations.design[self.changed]
        inner = np.diag(1.0 / self.change) + chosen @ self.spread
        return np.asarray(self.spread @ np.linalg.solve(inner, chosen @ before) - before)


@dataclass(frozen=True, slots=True)
class _Weighed:
    """c observations of a linear adjustment after changes of weights.

    Parameters
    ----------
    cofactor : array (c, c)
        H before the changes.
    residual, leverage, weight : arrays (c,)
        v, the diagonal of H, and the weights after them.
    square_sum : float
        Weighted square sum of all observations, up to a constant.
    changes : tuple of (g, column (c,))
    """

    cofactor: FloatArray
    residual: FloatArray
    leverage: FloatArray
    weight: FloatArray
    square_sum: float
    changes: tuple[tuple[float, FloatArray], ...] = ()

    @property
    def is_reduced(self) -> BoolArray:
        """Return which observations (c,) have lost weight."""
        return self.weight < 1.0

    def with_weight(self, row: int, weight: float) -> _Weighed:
        """Return the adjustment with another weight of an observation."""
        column = self.cofactor[:, row].copy()
        for factor, effect in self.changes:
            column -= factor * effect[row] * effect
        change = weight - self.weight[row]
        factor = change / (1.0 + change * column[row])
        weights = self.weight.copy()
        weights[row] = weight
        return _Weighed(
            self.cofactor,
            self.residual - factor * self.residual[row] * column,
            self.leverage - factor * column**2,
            weights,
            self.square_sum + factor * float(self.residual[row]) ** 2,
            (*self.changes, (factor, column)),
        )

    def consolidated(self) -> _Weighed:
        """Return the same with the cofactors after the changes: further changes then cost no more than the first."""
        if not self.changes:
            return self
        factors = np.array([factor for factor, _ in self.changes])
        effects = np.array([effect for _, effect in self.changes])
        return replace(self, cofactor=self.cofactor - (effects.T * factors) @ effects, changes=())

    def cost(self, limit: float) -> float:
        """Return the robust cost, up to a constant: that of these observations, half the square sum of all others."""
        others = self.square_sum - float(np.sum(self.weight * self.residual**2))
        return others / 2.0 + float(danish_costs(np.abs(self.residual), limit).sum())

    def gains(self, limit: float) -> tuple[FloatArray, FloatArray]:
        """Return the change (c,) of the cost by changing each observation, and the weights (c,) that it has then.

        One that has lost weight is taken back; one whose residual is more than half the limit loses its weight. What
        the others contribute to the cost is taken as unchanged. Infinite for all that cannot be changed.
        """
        gains, weights = np.full(len(self.residual), np.inf), self.other_weights(limit)
        rows = np.flatnonzero(weights != self.weight)
        now, then, residual = self.weight[rows], weights[rows], self.residual[rows]
        factor = 1.0 + (then - now) * self.leverage[rows]
        moved = residual / factor
        before = danish_costs(np.abs(residual), limit) - now * residual**2 / 2.0
        after = danish_costs(np.abs(moved), limit) - then * moved**2 / 2.0
        gains[rows] = (then - now) / factor * residual**2 / 2.0 + after - before
        return gains, weights

    def other_weights(self, limit: float) -> FloatArray:
        """Return 1 (c,) for observations that have lost weight, and for others the weight that agrees with itself.

        That is the weight of the residual that an observation has with this weight, 0 if there is none.
        """
        weights = np.where(self.weight < 1.0, 1.0, self.weight)
        in_use = (self.weight >= 1.0) & (np.abs(self.residual) > limit / 2.0)
        rows = np.flatnonzero(in_use & (1.0 - self.leverage > _TESTABLE))
        size, leverage, weight = np.abs(self.residual[rows]), self.leverage[rows], np.zeros(len(rows))
        for _ in range(3):
            moved = size / (1.0 - (1.0 - weight) * leverage)
            weight = np.where(moved > limit, np.exp(-moved / limit), 0.0)
        weights[rows] = weight
        return weights


def exchanges_to_try(
    equations: Equations, weights: FloatArray, normals: SolvedNormals, layout: Layout, limit: float
) -> tuple[Exchange, ...]:
    """Return exchanges that lower the robust cost of a converged solution, or may lower it, the most promising first.

    Parameters
    ----------
    equations : Equations
    weights : array (n,)
        Weight factors at the solution.
    normals : SolvedNormals
        With these weights, and their constraints.
    layout : Layout
    limit : float
        Standard residual up to which an observation has full weight.
    """
    judged = weights[equations.active & ~equations.exact]
    if np.count_nonzero(judged < 1.0) > max(_FEW, _MOST_PART * len(judged)):
        return ()
    rows = _rows_to_exchange(equations, weights, layout)
    cofactor = factored_rows(equations, weights, normals, layout, rows).cofactor()
    related = _related(cofactor, weights[rows]) | (np.abs(equations.residual[rows]) > limit / 2.0)
    rows, cofactor = rows[related], cofactor[np.ix_(related, related)]
    # the residuals after one more correction with the same normal equations
    right = equations.design.T @ (np.where(equations.active, weights, 0.0) * equations.residual)
    residual = equations.residual[rows] - equations.design[rows] @ normals.solve(right[:, None])[:, 0]
    weight = weights[rows]
    start = _Weighed(cofactor, residual, np.diag(cofactor).copy(), weight, float(np.sum(weight * residual**2)))
    return tuple(_exchange(start, end, rows, equations, normals) for end in _lowest(start, limit))


def _exchange(start: _Weighed, end: _Weighed, rows: IntArray, equations: Equations, normals: SolvedNormals) -> Exchange:
    """Return the exchange that leads from one to the other of two adjustments of some observations."""
    full = _with_their_groups(rows[start.is_reduced & ~end.is_reduced], equations)
    none = np.setdiff1d(_with_their_groups(rows[end.is_reduced & ~start.is_reduced], equations), full)
    places = np.flatnonzero(end.weight != start.weight)
    spread = normals.solve(equations.design[rows[places]].toarray().T)
    return Exchange(full, none, rows[places], (end.weight - start.weight)[places], spread)


def _with_their_groups(rows: IntArray, equations: Equations) -> IntArray:
    """Return observations with those that lose weight together with them."""
    if equations.groups is None:
        return rows
    groups = equations.groups[rows]
    return np.union1d(rows, np.flatnonzero(np.isin(equations.groups, groups[groups >= 0]) & equations.active))


def _rows_to_exchange(equations: Equations, weights: FloatArray, layout: Layout) -> IntArray:
    """Return the observations that may be exchanged: all, or in large blocks those of the points least in doubt.

    In large blocks they are the observations of the points with the smallest residuals among those that lost weight.
    """
    judged = np.flatnonzero(equations.active & ~equations.exact)
    if len(judged) <= _MOST_ROWS:
        return judged
    reduced = judged[weights[judged] < 1.0]
    reduced = reduced[np.argsort(np.abs(equations.residual[reduced]), kind="stable")[:_MOST_REDUCED]]
    points = equations.design[:, layout.reduced :]
    touched = np.unique(points[reduced].indices // 3)
    columns = (3 * touched[:, None] + np.arange(3)).ravel()
    beside = np.diff(points[judged][:, columns].tocsr().indptr) > 0
    return np.union1d(reduced, judged[beside])


def _related(cofactor: FloatArray, weight: FloatArray) -> BoolArray:
    """Return which observations (c,) have lost weight, or share an error with one that has."""
    reduced = weight < 1.0
    leverage = np.diag(cofactor)
    # the part of an error of the reduced observation, taken back, that appears in the other one
    shared = np.abs(cofactor[:, reduced]) / (1.0 + (1.0 - weight[reduced]) * leverage[reduced])
    return np.asarray(reduced | (shared.max(axis=1, initial=0.0) > _SHARED))


def _lowest(start: _Weighed, limit: float) -> list[_Weighed]:
    """Return the ends of lowest cost that changes of one weight after the other lead to, the lowest first.

    They begin with any one observation, and again from the lowest end as long as the cost falls. Ends that began at
    the start follow where they are no lower than that, but hardly higher.
    """
    first = _ends(start, limit)
    best, ends, least = start, first, start.cost(limit)
    for _ in range(_ROUNDS):
        if not ends or ends[0][0] > least - _LEAST_GAIN * limit**2:
            break
        least, best = ends[0][0], ends[0][1].consolidated()
        ends = _ends(best, limit)
    doubtful = start.cost(limit) + _DOUBT * limit**2
    tried = [best, *(end for cost, end in first if cost < doubtful)]
    distinct = {end.is_reduced.tobytes(): end for end in reversed(tried)}
    distinct.pop(start.is_reduced.tobytes(), None)
    return list(distinct.values())[::-1][:_MOST_FOUND]


def _ends(start: _Weighed, limit: float) -> list[tuple[float, _Weighed]]:
    """Return where the changes of one observation lead to, with the costs, the lowest first."""
    passed: set[bytes] = set()
    ends = (_descended(first, row, limit, passed) for first, row in _first_changes(start, limit))
    return sorted((end for end in ends if end is not None), key=itemgetter(0))


def _first_changes(best: _Weighed, limit: float) -> Iterator[tuple[_Weighed, int]]:
    """Yield an adjustment with one observation taken back, or taken back in exchange for another, or one left out."""
    reduced = np.flatnonzero(best.weight < 1.0)
    nearest = reduced[np.argsort(np.abs(best.residual[reduced]), kind="stable")[:_MOST_TAKEN_BACK]]
    for row in nearest.tolist():
        taken_back = best.with_weight(row, 1.0)
        yield taken_back, row
        for other, gain, weight in _best_changes(taken_back, row, limit)[1:]:
            if gain < 0.0:
                yield taken_back.with_weight(other, weight), row
    gains, weights = best.gains(limit)
    gains[best.weight < 1.0] = np.inf
    for row in np.argsort(gains, kind="stable")[:_ALTERNATIVES].tolist():
        if np.isfinite(gains[row]):
            yield best.with_weight(row, float(weights[row])), row


def _best_changes(now: _Weighed, changed: int, limit: float) -> list[tuple[int, float, float]]:
    """Return the observations by whose change the cost falls most: number, change of the cost, weight."""
    gains, weights = now.gains(limit)
    gains[changed] = np.inf
    order = np.argsort(gains, kind="stable")[:_ALTERNATIVES]
    return list(zip(order.tolist(), gains[order].tolist(), weights[order].tolist(), strict=True))


def _descended(now: _Weighed, changed: int, limit: float, passed: set[bytes]) -> tuple[float, _Weighed] | None:
    """Return the lowest cost that changes of one weight after the other lead to; one observation stays as it is.

    None where the same observations have lost weight as on a way before: it goes on to the same end. `passed` are the
    ways so far.
    """
    cost = now.cost(limit)
    for _ in range(_LONGEST):
        row, gain, weight = _best_changes(now, changed, limit)[0]
        if gain >= 0.0:
            break
        moved = now.with_weight(row, weight)
        lower = moved.cost(limit)
        if lower >= cost:
            break
        now, cost = moved, lower
        here = now.is_reduced.tobytes()
        if here in passed:
            return None
        passed.add(here)
    return cost, now
