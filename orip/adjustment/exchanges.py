"""Whether the robust cost is lower if other observations lose their weight, or with a block at another place."""

from __future__ import annotations

from collections.abc import Sequence
from operator import attrgetter
from typing import NamedTuple

import numpy as np
from msgspec import Struct

from orip.adjustment.equations import Equations, Layout, OtherPlace
from orip.adjustment.normals import SolvedNormals
from orip.adjustment.residual_sums import factored_rows
from orip.adjustment.weight_changes import ORDINARY, LinearAdjustment, Thresholds
from orip.adjustment.weight_search import MOST_ROUNDS, weights_of_lower_cost
from orip.adjustment.weights import danish_costs
from orip.arrays import BoolArray, FloatArray, IntArray
from orip.structs import replace

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

        `equations` have the design matrix of the normal equations, whose weights (n,) are given, `normals` their
        constraints.
        """
        weighted = equations.effective(weights) * residual
        weighted[self.changed] += self.change * residual[self.changed]
        before = normals.solve((equations.design.T @ weighted)[:, None])[:, 0]
        chosen = equations.design[self.changed]
        inner = np.diag(1.0 / self.change) + chosen @ self.spread
        return np.asarray(self.spread @ np.linalg.solve(inner, chosen @ before) - before)


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
    cofactor = factored_rows(equations, weights, normals, layout, rows).cofactor()
    leverage = weights[rows] * np.diag(cofactor)
    is_large = np.abs(equations.residual[rows]) > thresholds.residuals(1.0 - leverage, limit)
    related = _related(cofactor, weights[rows]) | is_large
    rows, cofactor = rows[related], cofactor[np.ix_(related, related)]
    # the residuals after one more correction with the same normal equations
    weighted = equations.effective(weights) * equations.residual
    right = equations.design.T @ weighted
    correction = normals.solve(right[:, None])[:, 0]
    residual = equations.residual[rows] - equations.design[rows] @ correction
    square_sum = float(weighted @ np.where(equations.active, equations.residual, 0.0) - right @ correction)
    weight = weights[rows]
    start = LinearAdjustment(cofactor, residual, weight, square_sum, thresholds)
    ends = weights_of_lower_cost(start, limit, rounds)
    return tuple(_exchange(weight, end, rows, equations, normals) for end in ends)


def _exchange(
    before: FloatArray, after: FloatArray, rows: IntArray, equations: Equations, normals: SolvedNormals
) -> Exchange:
    """Return the exchange that changes the weights (c,) of some observations."""
    full = _with_their_groups(rows[(before < 1.0) & (after >= 1.0)], equations)
    none = np.setdiff1d(_with_their_groups(rows[(after < 1.0) & (before >= 1.0)], equations), full)
    places = np.flatnonzero(after != before)
    spread = normals.solve(equations.design[rows[places]].toarray().T)
    return Exchange(full, none, rows[places], (after - before)[places], spread)


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


def _related(cofactor: FloatArray, weight: FloatArray) -> BoolArray:
    """Return which observations (c,) have lost weight, or share an error with one that has."""
    reduced = weight < 1.0
    leverage = np.diag(cofactor)
    # the part of an error of the reduced observation, taken back, that appears in the other one
    shared = np.abs(cofactor[:, reduced]) / (1.0 + (1.0 - weight[reduced]) * leverage[reduced])
    return np.asarray(reduced | (shared.max(axis=1, initial=0.0) > _SHARED))


# The observations of a block act on the reduced unknowns by the combinations C of their rows that are free of it: with
# weighted rows R of reduced unknowns and B of the block, C = Q^T R and c = Q^T v, where the columns of Q span what is
# orthogonal to B. At another place these are others. With U both of them below each other, s = -1 for the old ones and
# 1 for the new ones, and H = U N^-1 U^T, the square sum changes by
#
#     c^T s c - d^T (H - H (s + H)^-1 H) d,  d = s c
#
# (Sherman, Morrison and Woodbury). Exact where the reduced unknowns are linear; the block itself may move anywhere.


class _Freed(Struct, frozen=True):
    """Combinations of observations that are free of their block: rows (k - 3, m) and residuals (k - 3,)."""

    rows: FloatArray
    residual: FloatArray


class Relocation(Struct, frozen=True):
    """A block at another place.

    Parameters
    ----------
    place : OtherPlace
    change : float
        Of the robust cost.
    """

    place: OtherPlace
    change: float
    old: _Freed
    new: _Freed


class Relocations(Struct, frozen=True):
    """Blocks at other places.

    Parameters
    ----------
    single : sequence of Relocation
    remaining : array (m + 3 b,)
        The correction without them.
    normals : SolvedNormals
    """

    single: Sequence[Relocation]
    remaining: FloatArray
    normals: SolvedNormals

    def by_cost(self, most: float) -> list[Relocation]:
        """Return those by which the cost changes by less than `most`, the lowest first."""
        return sorted((one for one in self.single if one.change < most), key=attrgetter("change"))

    def of_different_blocks(self, most: float) -> list[Relocation]:
        """Return the best one of each block by which the cost changes by less than `most`."""
        best = {one.place.columns.tobytes(): one for one in reversed(self.by_cost(most))}
        return list(best.values())

    def correction(self, chosen: Sequence[Relocation]) -> FloatArray:
        """Return the correction (m + 3 b,) that leads to all of the chosen ones together."""
        moved = self.remaining.copy()
        for one in chosen:
            both = np.vstack([one.old.rows, one.new.rows])
            on_blocks = np.zeros((len(self.remaining) - both.shape[1], len(both)))
            spread = self.normals.solve(np.vstack([both.T, on_blocks]))
            pull, inner = _pulls(one.old, one.new, both @ spread[: both.shape[1]])
            moved -= spread @ (pull - inner)
        for one in chosen:
            place = one.place
            root = np.sqrt(place.weights)
            there = place.residual + place.reduced @ moved[: place.reduced.shape[1]]
            own, *_ = np.linalg.lstsq(place.own * root[:, None], -root * there, rcond=None)
            moved[place.columns] = place.move + own
        return moved


def relocations(
    places: Sequence[OtherPlace],
    equations: Equations,
    weights: FloatArray,
    normals: SolvedNormals,
    layout: Layout,
    limit: float,
) -> Relocations:
    """Return what becomes of the robust cost with blocks at other places.

    Parameters
    ----------
    places : sequence of OtherPlace
    equations : Equations
        With the design matrix of the normal equations, and the groups that the cost has.
    weights : array (n,)
        Of the normal equations.
    normals : SolvedNormals
    layout : Layout
    limit : float
        Standard residual up to which an observation has full weight.
    """
    right = equations.design.T @ (equations.effective(weights) * equations.residual)
    remaining = -normals.solve(right[:, None])[:, 0]
    reduced, of_reduced = layout.reduced, remaining[: layout.reduced]
    blocks: dict[bytes, tuple[_Freed, float]] = {}
    found = []
    for place in places:
        rows, key = place.rows, place.columns.tobytes()
        if key not in blocks:
            design, before = equations.design[rows].toarray(), equations.residual[rows]
            freed = _freed(design[:, :reduced], design[:, place.columns], before, weights[rows], of_reduced)
            blocks[key] = freed, _beyond_squares(before, weights[rows], _groups(equations, rows), limit)
        old, beyond = blocks[key]
        new = _freed(place.reduced, place.own, place.residual, place.weights, of_reduced)
        # there what keeps its weight has to fit
        none = place.weights < 1.0
        groups = _groups(equations, rows[none])
        more = _beyond_squares(place.residual[none], place.weights[none], groups, limit) - beyond
        found.append(Relocation(place, more, old, new))
    return Relocations(_with_square_sums(found, normals), remaining, normals)


def _with_square_sums(found: Sequence[Relocation], normals: SolvedNormals) -> list[Relocation]:
    """Return relocations whose change of the cost has that of half the square sum, too."""
    rows = np.vstack([part.rows for one in found for part in (one.old, one.new)])
    spread = normals.factor.reduce(rows.T / normals.scale[:, None])
    complete, first = [], 0
    for one in found:
        sign, residual = _both(one.old, one.new)
        own = spread[:, first : first + len(sign)]
        first += len(sign)
        effect = own.T @ own
        pull, inner = _pulls(one.old, one.new, effect)
        square_sum = float(sign @ residual**2 - (effect @ pull) @ (pull - inner))
        complete.append(replace(one, change=one.change + square_sum / 2.0))
    return complete


def _both(old: _Freed, new: _Freed) -> tuple[FloatArray, FloatArray]:
    """Return s and c."""
    sign = np.repeat([-1.0, 1.0], [len(old.residual), len(new.residual)])
    return sign, np.concatenate([old.residual, new.residual])


def _pulls(old: _Freed, new: _Freed, effect: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return d and (s + H)^-1 H d."""
    sign, residual = _both(old, new)
    pull = sign * residual
    return pull, np.asarray(np.linalg.solve(np.diag(sign) + effect, effect @ pull), dtype=np.float64)


def _freed(
    reduced: FloatArray, own: FloatArray, residual: FloatArray, weights: FloatArray, remaining: FloatArray
) -> _Freed:
    """Return the weighted combinations free of the block, after what remains of the reduced unknowns, array (m,)."""
    root = np.sqrt(weights)
    complete, _ = np.linalg.qr(own * root[:, None], mode="complete")
    free = (complete[:, 3:] * root[:, None]).T
    rows = free @ reduced
    return _Freed(rows, free @ residual + rows @ remaining)


def changed_weights(chosen: Sequence[Relocation], weights: FloatArray) -> tuple[IntArray, IntArray]:
    """Return the observations that get full weight, and those that lose theirs, of the weights (n,)."""
    rows = np.concatenate([one.place.rows for one in chosen])
    there = np.concatenate([one.place.weights for one in chosen])
    return rows[(there >= 1.0) & (weights[rows] < 1.0)], rows[(there < 1.0) & (weights[rows] >= 1.0)]


def _groups(equations: Equations, rows: IntArray) -> IntArray:
    """Return in which group each of some observations (k,) loses weight; alone where there are none."""
    alone = np.arange(len(rows))
    if equations.groups is None:
        return alone
    groups = equations.groups[rows]
    _, numbers = np.unique(np.where(groups < 0, -1 - alone, groups), return_inverse=True)
    return np.asarray(numbers)


def _beyond_squares(residual: FloatArray, weights: FloatArray, groups: IntArray, limit: float) -> float:
    """Return what residuals (k,) cost beyond half of their weighted square sum; those of a group together."""
    sizes = np.sqrt(np.bincount(groups, residual**2))
    return float(np.sum(danish_costs(sizes, limit)) - np.sum(weights * residual**2) / 2.0)
