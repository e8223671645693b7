"""Changes of weights in a linear adjustment: what the robust cost becomes, without adjusting again.

With cofactors H = A Q A^T of the adjusted observations, a change d of the weight of observation i changes the residuals
by -H_i g v_i with g = d / (1 + d h_i), the cofactors by -g H_i H_i^T and the weighted square sum by g v_i^2. Several
changes D at once change them by -H_p K v_p, -H_p K H_p^T and v_p^T K v_p, with K = (D^-1 + H_pp)^-1 (Sherman, Morrison
and Woodbury).
"""

from __future__ import annotations

from collections.abc import Sequence
from operator import itemgetter
from typing import NamedTuple

import numpy as np
from msgspec import Struct

from orip.adjustment.weights import danish_costs
from orip.arrays import BoolArray, FloatArray, IntArray

_LEAST_GAIN, _DOUBT = 0.0005, 0.01
"""Part of the square of the limit by which the cost has to fall; changes after which it is higher by no more than the
second are doubtful: residuals of dozens of a-priori errors are not linear, and only an adjustment tells."""

_MOST_FOUND = 8
"""Ends that are looked at without the linearisation, at one solution."""

_ALTERNATIVES = 4
_LONGEST = 12

MOST_ROUNDS = 10
"""Times that changes begin again from the lowest end."""
_COMMON = (0.1, 0.2, 0.4)
"""Coefficients of correlation above which adjusted observations turn the same photo."""

_LIKE, _MOST_ALIKE, _MOST_PAIRS = 1.25, 12, 60
"""Ratio up to which residuals are alike, one to the next; most of them that are taken back together; and most pairs."""

_HUBER, _CONVEX, _DANISH = 2.0, 20, 15
"""Residual up to which Huber's weights are 1, iterations with them, and iterations of the Danish method after these."""

_LEAST_WEIGHT, _STEADY = 1e-10, 1e-4
"""Of an observation; and the part of a weight by which it changes at least."""

_TESTABLE = 0.03
"""Least redundancy number of an observation that may lose its weight."""


class LinearAdjustment(Struct, frozen=True):
    """c observations of a linear adjustment.

    Parameters
    ----------
    cofactor : array (c, c)
        H.
    residual, weight : arrays (c,)
    square_sum : float
        Weighted square sum of all observations of the adjustment, these and others.
    """

    cofactor: FloatArray
    residual: FloatArray
    weight: FloatArray
    square_sum: float

    def with_weights(self, weights: FloatArray) -> LinearAdjustment:
        """Return the adjustment with other weights (c,)."""
        places = np.flatnonzero(weights != self.weight)
        columns, residual = self.cofactor[:, places], self.residual[places]
        inner = np.diag(1.0 / (weights - self.weight)[places]) + columns[places]
        spread = np.linalg.solve(inner, columns.T)
        return LinearAdjustment(
            self.cofactor - columns @ spread,
            self.residual - spread.T @ residual,
            weights,
            self.square_sum + float(residual @ np.linalg.solve(inner, residual)),
        )


class _Ways(Struct, frozen=True):
    """s ways of changing the weights of c observations, one after the other, after k changes.

    Parameters
    ----------
    cofactor : array (c, c)
        H before the changes.
    residual, leverage, weight : arrays (s, c)
        v, the diagonal of H, and the weights after them.
    square_sum : array (s,)
    factor, effect : tuples of k arrays (s,), (s, c)
        g and H_i of the changes.
    """

    cofactor: FloatArray
    residual: FloatArray
    leverage: FloatArray
    weight: FloatArray
    square_sum: FloatArray
    factor: tuple[FloatArray, ...] = ()
    effect: tuple[FloatArray, ...] = ()

    def chosen(self, ways: IntArray | BoolArray) -> _Ways:
        """Return some of the ways; one may be chosen several times."""
        return _Ways(
            self.cofactor, self.residual[ways], self.leverage[ways], self.weight[ways], self.square_sum[ways],
            tuple(factor[ways] for factor in self.factor), tuple(effect[ways] for effect in self.effect),
        )  # fmt: skip

    def changed(self, rows: IntArray, weights: FloatArray) -> _Ways:
        """Return the ways after one more change: the observations `rows` (s,) get `weights` (s,)."""
        ways = np.arange(len(rows))
        column = self.cofactor[rows]
        for before, effect in zip(self.factor, self.effect, strict=True):
            column = column - (before * effect[ways, rows])[:, None] * effect
        change = weights - self.weight[ways, rows]
        factor = change / (1.0 + change * column[ways, rows])
        after = self.weight.copy()
        after[ways, rows] = weights
        return _Ways(
            self.cofactor,
            self.residual - (factor * self.residual[ways, rows])[:, None] * column,
            self.leverage - factor[:, None] * column**2,
            after,
            self.square_sum + factor * self.residual[ways, rows] ** 2,
            (*self.factor, factor),
            (*self.effect, column),
        )

    def costs(self, limit: float) -> FloatArray:
        """Return the robust costs (s,): half the square sum where observations fit.

        Infinite where the square sum has come to less than the part of some observations. The cofactors are those of
        the iteration before: their small errors count more than all else where a residual of thousands of a-priori
        errors is taken back.
        """
        above = (self.weight < 1.0) | (np.abs(self.residual) > limit)
        ways, _ = np.nonzero(above)
        residual = self.residual[above]
        of_others = self.square_sum - np.bincount(ways, self.weight[above] * residual**2, len(self.square_sum))
        costs = of_others / 2.0 + np.bincount(ways, danish_costs(np.abs(residual), limit), len(self.square_sum))
        return np.where(of_others >= -_LEAST_GAIN * limit**2, costs, np.inf)

    def gains(self, limit: float) -> tuple[FloatArray, FloatArray]:
        """Return the change (s, c) of the cost by changing each observation, and the weights (s, c) that it has then.

        One that has lost weight is taken back; one whose residual is more than half the limit loses its weight. What
        the others contribute to the cost is taken as unchanged. Infinite for all that cannot be changed.
        """
        weights, gains = self._other_weights(limit), np.full(self.weight.shape, np.inf)
        places = np.nonzero(weights != self.weight)
        now, then, residual = self.weight[places], weights[places], self.residual[places]
        factor = 1.0 + (then - now) * self.leverage[places]
        moved = residual / factor
        before = danish_costs(np.abs(residual), limit) - now * residual**2 / 2.0
        after = danish_costs(np.abs(moved), limit) - then * moved**2 / 2.0
        gains[places] = (then - now) / factor * residual**2 / 2.0 + after - before
        return gains, weights

    def _other_weights(self, limit: float) -> FloatArray:
        """Return 1 (s, c) for observations that have lost weight, and for others the weight that agrees with itself.

        That is the weight of the residual that an observation has with this weight, 0 if there is none.
        """
        weights = np.where(self.weight < 1.0, 1.0, self.weight)
        in_use = (self.weight >= 1.0) & (1.0 - self.leverage > _TESTABLE)
        in_use &= may_lose_weight(self.residual, self.leverage, limit)
        places = np.nonzero(in_use)
        size, leverage = np.abs(self.residual[places]), self.leverage[places]
        weight = np.zeros(len(size))
        for _ in range(3):
            moved = size / (1.0 - (1.0 - weight) * leverage)
            weight = np.where(moved > limit, np.exp(-moved / limit), 0.0)
        weights[places] = weight
        return weights


def may_lose_weight(residual: FloatArray, leverage: FloatArray, limit: float) -> BoolArray:
    """Return for which observations of full weight the cost may fall without them.

    Where an observation alone determines something, nearly, its residual is small however wrong it is.
    """
    return np.asarray(np.abs(residual) > limit * np.minimum(0.5, 1.0 - leverage))


class _End(NamedTuple):
    """The cost that a way leads to, and the weights (c,) there."""

    cost: float
    weight: FloatArray


def weights_of_lower_cost(start: LinearAdjustment, limit: float, rounds: int = MOST_ROUNDS) -> list[FloatArray]:
    """Return the weights (c,) of lowest cost that changes of one weight after the other lead to, the lowest first.

    They begin with any one observation, and again from the lowest end as long as the cost falls. Ends that began at
    the start follow where they are no lower than that, but hardly higher.

    Parameters
    ----------
    start : LinearAdjustment
    limit : float
        Standard residual up to which an observation has full weight.
    rounds : int
        Most times that changes begin again.
    """
    at_start = float(_begun(start, 1).costs(limit)[0])
    first = _ends(start, limit)
    best, least = _lowest_from(start, first, at_start, limit, rounds)
    elsewhere = _after_convex_weights(start, limit)
    at_first = float(_begun(elsewhere, 1).costs(limit)[0])
    other, cost = _lowest_from(elsewhere, _ends(elsewhere, limit), at_first, limit, rounds)
    best = other if cost < least else best
    doubtful = at_start + _DOUBT * limit**2
    likely = [end.weight for end in first if end.cost < doubtful]
    # what is taken back may be far from linear, and may push out what is not
    likely.sort(key=lambda weight: bool(((weight >= 1.0) & (start.weight < 1.0)).any()))
    tried = [best.weight, *likely]
    distinct = {(weight < 1.0).tobytes(): weight for weight in reversed(tried)}
    distinct.pop((start.weight < 1.0).tobytes(), None)
    return list(distinct.values())[::-1][:_MOST_FOUND]


def _lowest_from(
    start: LinearAdjustment, ends: list[_End], least: float, limit: float, rounds: int
) -> tuple[LinearAdjustment, float]:
    """Return where rounds of changes lead to as long as the cost falls, and the cost there."""
    best = start
    for _ in range(rounds):
        if not ends or ends[0].cost > least - _LEAST_GAIN * limit**2:
            break
        least, best = ends[0].cost, best.with_weights(ends[0].weight)
        ends = _ends(best, limit)
    return best, least


def _after_convex_weights(start: LinearAdjustment, limit: float) -> LinearAdjustment:
    """Return the adjustment with weights of the Danish method that begins at the minimum with Huber's weights.

    That minimum is the only one, wherever the iterations have ended: several observations that are wrong together, and
    have turned a photo, hold what changes of one after the other would have to pass. Adjusting to it would take dozens
    of iterations.
    """
    now = start
    for _ in range(_CONVEX):
        now = _steadier(now, np.minimum(1.0, _HUBER / _sizes(now)))
    for _ in range(_DANISH):
        size = _sizes(now)
        now = _steadier(now, np.where(size > limit, np.exp(-size / limit), 1.0))
    return now


def _sizes(now: LinearAdjustment) -> FloatArray:
    return np.asarray(np.maximum(np.abs(now.residual), _LEAST_WEIGHT))


def _steadier(now: LinearAdjustment, weights: FloatArray) -> LinearAdjustment:
    """Return the adjustment with weights (c,) that differ; hardly a change is none."""
    weights = np.maximum(weights, _LEAST_WEIGHT)
    weights = np.where(np.abs(weights - now.weight) < _STEADY * now.weight, now.weight, weights)
    return now if np.array_equal(weights, now.weight) else now.with_weights(weights)


def _begun(start: LinearAdjustment, ways: int) -> _Ways:
    def repeated(values: FloatArray) -> FloatArray:
        return np.repeat(values[None], ways, axis=0)

    leverage = np.diag(start.cofactor)
    residual, weight = repeated(start.residual), repeated(start.weight)
    return _Ways(start.cofactor, residual, repeated(leverage), weight, np.full(ways, start.square_sum))


def _ends(start: LinearAdjustment, limit: float) -> list[_End]:
    """Return where changes of one weight after the other lead to, the lowest cost first.

    The observation that is changed first stays as it is. Where the same observations have lost weight as on a way
    before, the way is given up: both go on to the same end.
    """
    ways, held = _first_changes(start, limit)
    costs, ends, passed = ways.costs(limit), list[_End](), set[bytes]()
    for _ in range(_LONGEST):
        if not len(held):
            break
        numbers = np.arange(len(held))
        gains, weights = ways.gains(limit)
        gains[numbers, held] = np.inf
        rows = gains.argmin(axis=1)
        moved = ways.changed(rows, weights[numbers, rows])
        lower = moved.costs(limit)
        falls = (gains[numbers, rows] < 0.0) & (lower < costs)
        ends += map(_End, costs[~falls].tolist(), ways.weight[~falls])
        going = np.array([way for way in np.flatnonzero(falls) if _is_new(moved.weight[way], passed)], dtype=np.intp)
        ways, held, costs = moved.chosen(going), held[going], lower[going]
    ends += map(_End, costs.tolist(), ways.weight)
    return sorted(ends, key=itemgetter(0))


def _is_new(weight: FloatArray, passed: set[bytes]) -> bool:
    """Return whether no way before has come to the same observations without weight, and note that one has."""
    reduced = (weight < 1.0).tobytes()
    is_new = reduced not in passed
    passed.add(reduced)
    return is_new


def _first_changes(start: LinearAdjustment, limit: float) -> tuple[_Ways, IntArray]:
    """Return the beginnings of ways, and the observation (s,) that each of them changes first.

    An observation is taken back by itself, or in exchange for one of those that gain most from it, or together with
    others of like residuals; or one is left out.
    """
    reduced = np.flatnonzero(start.weight < 1.0)
    nearest = reduced[np.argsort(np.abs(start.residual[reduced]), kind="stable")]
    alone = _begun(start, 1)
    of_all, other_weights = (values[0] for values in alone.gains(limit))
    of_all[reduced] = np.inf
    most = np.argsort(of_all, kind="stable")[:_ALTERNATIVES]
    left_out = most[np.isfinite(of_all[most])]
    first = np.concatenate([nearest, left_out])
    ways = _begun(start, len(first)).changed(first, other_weights[first])
    taken_back = ways.chosen(np.arange(len(nearest)))
    gains, weights = taken_back.gains(limit)
    gains[np.arange(len(nearest)), nearest] = np.inf
    # the best change is what the way itself goes on with
    others = np.argsort(gains, axis=1, kind="stable")[:, 1:_ALTERNATIVES]
    number, place = np.nonzero(np.take_along_axis(gains, others, axis=1) < 0.0)
    rows = others[number, place]
    exchanged = taken_back.chosen(number).changed(rows, weights[number, rows])
    lots = _alike(start, nearest)
    held = [first, nearest[number], *(lot[:1] for lot in lots)]
    return _joined([ways, exchanged, *_taken_back_together(alone, lots)]), np.concatenate(held)


def _taken_back_together(alone: _Ways, lots: list[IntArray]) -> list[_Ways]:
    """Return the ways that begin with lots of observations taken back, in the order of the lots."""
    if not lots:
        return []
    sizes = np.array([len(lot) for lot in lots])
    found, places = [], []
    for size in np.unique(sizes).tolist():
        of_size = np.flatnonzero(sizes == size)
        rows, ways = np.array([lots[n] for n in of_size.tolist()]), alone.chosen(np.zeros_like(of_size))
        for place in range(size):
            ways = ways.changed(rows[:, place], np.ones(len(rows)))
        found.append(ways)
        places.append(of_size)
    return [_joined(found).chosen(np.argsort(np.concatenate(places)))]


def _alike(start: LinearAdjustment, nearest: IntArray) -> list[IntArray]:
    """Return lots of observations that have lost weight, to be taken back together.

    Neighbours that are wrong by the same amount turn their photo, and push out what is right: of these, too, the
    residuals are alike. One that is taken back alone meets all the others. `nearest` are in the order of their size;
    pairs are those that have most in common.
    """
    size = np.abs(start.residual[nearest])
    lots = np.split(nearest, np.flatnonzero(size[1:] > _LIKE * size[:-1]) + 1)
    cofactor = start.cofactor[np.ix_(nearest, nearest)]
    scale = np.sqrt(np.maximum(np.diag(cofactor), _LEAST_WEIGHT))
    common = np.abs(cofactor) / np.outer(scale, scale)
    first, second = np.triu_indices(len(nearest), 1)
    most = np.argsort(-common[first, second], kind="stable")[:_MOST_PAIRS]
    pairs = [nearest[[one, other]] for one, other in zip(first[most].tolist(), second[most].tolist(), strict=True)]
    for least in _COMMON:
        lots += [nearest[beside] for beside in common > least]
    distinct = {lot.tobytes(): lot for lot in lots if 2 < len(lot) <= _MOST_ALIKE}
    return [*distinct.values(), *pairs]


def _joined(lots: Sequence[_Ways]) -> _Ways:
    """Return several lots of ways as one, whatever the numbers of changes they have made."""
    changes = max(len(ways.factor) for ways in lots)
    padded = [_padded(ways, changes) for ways in lots]
    return _Ways(
        lots[0].cofactor,
        np.vstack([ways.residual for ways in lots]),
        np.vstack([ways.leverage for ways in lots]),
        np.vstack([ways.weight for ways in lots]),
        np.concatenate([ways.square_sum for ways in lots]),
        tuple(np.concatenate([factor[n] for factor, _ in padded]) for n in range(changes)),
        tuple(np.concatenate([effect[n] for _, effect in padded]) for n in range(changes)),
    )


def _padded(ways: _Ways, changes: int) -> tuple[tuple[FloatArray, ...], tuple[FloatArray, ...]]:
    """Return factors and effects of so many changes: those that are missing change nothing."""
    missing = changes - len(ways.factor)
    nothing = np.zeros(len(ways.square_sum))
    return (*ways.factor, *[nothing] * missing), (*ways.effect, *[np.zeros_like(ways.residual)] * missing)
