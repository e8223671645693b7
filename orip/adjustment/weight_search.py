"""The search for weights with which the robust cost of a linear adjustment is lower: changes of one after the other."""

from __future__ import annotations

from collections.abc import Sequence
from operator import itemgetter
from typing import NamedTuple

import numpy as np

from orip.adjustment.weight_changes import LEAST_GAIN, TESTABLE, LinearAdjustment, Ways, are_many, begun
from orip.adjustment.weights import danish_costs
from orip.arrays import FloatArray, IntArray

_ALTERNATIVES = 4

_COMMON = (0.1, 0.2, 0.4)
"""Coefficients of correlation above which adjusted observations turn the same photo."""

_LIKE, _MOST_ALIKE, _MOST_PAIRS = 1.25, 12, 60
"""Ratio up to which residuals are alike, one to the next; most of them that are taken back together; and most pairs."""

_SMALL, _HIDING = 0.1, 0.2
"""Part of the limit below which no residual is looked at; and correlation of residuals above which two observations
hide each other."""

_NOT_ZERO = _NO_WEIGHT = 1e-10


def first_changes(start: LinearAdjustment, limit: float) -> tuple[Ways, IntArray]:
    """Return the beginnings of ways, and the observation (s,) that each of them changes first.

    An observation is taken back by itself, or in exchange for one of those that gain most from it, or together with
    others of like residuals; or one is left out.
    """
    reduced = np.flatnonzero(start.weight < 1.0)
    nearest = reduced[np.argsort(np.abs(start.residual[reduced]), kind="stable")]
    alone = begun(start, 1)
    of_all, other_weights = (values[0] for values in alone.gains(limit))
    of_all[reduced] = np.inf
    most = np.argsort(of_all, kind="stable")[:_ALTERNATIVES]
    left_out = most[np.isfinite(of_all[most])]
    first = np.concatenate([nearest, left_out])
    ways = begun(start, len(first)).changed(first, other_weights[first])
    taken_back = ways.chosen(np.arange(len(nearest)))
    gains, weights = taken_back.gains(limit)
    gains[np.arange(len(nearest)), nearest] = np.inf
    # the best change is what the way itself goes on with
    others = np.argsort(gains, axis=1, kind="stable")[:, 1:_ALTERNATIVES]
    number, place = np.nonzero(np.take_along_axis(gains, others, axis=1) < 0.0)
    rows = others[number, place]
    exchanged = taken_back.chosen(number).changed(rows, weights[number, rows])
    lots = _alike(start, nearest)
    pairs, of_pairs = _hiding_each_other(start, limit)
    hidden = alone.chosen(np.zeros(len(pairs), dtype=np.intp))
    for member in range(2):
        hidden = hidden.changed(pairs[:, member], of_pairs[:, member])
    single = np.concatenate([first, nearest[number], *(lot[:1] for lot in lots)])
    held = np.vstack([np.column_stack([single, single]), pairs])
    return _joined([ways, exchanged, *taken_back_together(alone, lots), hidden]), held


def _hiding_each_other(start: LinearAdjustment, limit: float) -> tuple[IntArray, FloatArray]:
    """Return pairs (p, 2) of observations to be left out together, and the weights that they have then.

    Neighbours that are wrong by the same amount determine their photo together: the residual of either stays small
    without the other one. The pairs are those by which the cost rises least, or falls.
    """
    if not are_many(start.weight, start.residual, limit):
        return np.zeros((0, 2), dtype=np.intp), np.zeros((0, 2))
    free = 1.0 - np.diag(start.cofactor)
    rows = np.flatnonzero((start.weight >= 1.0) & (free > TESTABLE) & (np.abs(start.residual) > _SMALL * limit))
    first, second = np.triu_indices(len(rows), 1)
    one, other = rows[first], rows[second]
    common = start.cofactor[one, other]
    likely = np.abs(common) > _HIDING * np.sqrt(free[one] * free[other])
    one, other, common = one[likely], other[likely], common[likely]
    determinant = free[one] * free[other] - common**2
    residual = np.column_stack([start.residual[one], start.residual[other]])
    crossed = np.column_stack([free[other], free[one]]) * residual + common[:, None] * residual[:, ::-1]
    testable = determinant > start.thresholds.determinant
    one, other, residual = one[testable], other[testable], residual[testable]
    size = np.abs(crossed[testable] / determinant[testable, None])
    square_sums = (residual * crossed[testable] / determinant[testable, None]).sum(axis=1)
    costs = danish_costs(size, limit).sum(axis=1) - square_sums / 2.0
    chosen = np.flatnonzero((size > limit).all(axis=1))
    chosen = chosen[np.argsort(costs[chosen], kind="stable")[: start.thresholds.most_pairs]]
    return np.column_stack([one, other])[chosen], np.exp(-size[chosen] / limit)


def left_out_together(start: LinearAdjustment, limit: float) -> list[FloatArray]:
    """Return weights (c,) without two observations that hide each other, and without a third one that fits least then.

    Three neighbours that are wrong by the same amount hold their photo where it is, whichever two of them are left out.
    """
    found = []
    for pair in _hiding_each_other(start, limit)[0]:
        without = start.weight.copy()
        without[pair] = _NO_WEIGHT
        there = start.with_weights(without)
        free = 1.0 - np.diag(there.cofactor)
        fall = np.where((without >= 1.0) & (free > TESTABLE), there.residual**2 / np.maximum(free, TESTABLE), 0.0)
        third = without.copy()
        third[fall.argmax()] = _NO_WEIGHT
        found += [without, third]
    return found


def taken_back_together(alone: Ways, lots: list[IntArray]) -> list[Ways]:
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
    scale = np.sqrt(np.maximum(np.diag(cofactor), _NOT_ZERO))
    common = np.abs(cofactor) / np.outer(scale, scale)
    first, second = np.triu_indices(len(nearest), 1)
    most = np.argsort(-common[first, second], kind="stable")[:_MOST_PAIRS]
    pairs = [nearest[[one, other]] for one, other in zip(first[most].tolist(), second[most].tolist(), strict=True)]
    for least in _COMMON:
        lots += [nearest[beside] for beside in common > least]
    distinct = {lot.tobytes(): lot for lot in lots if 2 < len(lot) <= _MOST_ALIKE}
    return [*distinct.values(), *pairs]


def _joined(lots: Sequence[Ways]) -> Ways:
    """Return several lots of ways as one, whatever the numbers of changes they have made."""
    changes = max(len(ways.factor) for ways in lots)
    padded = [_padded(ways, changes) for ways in lots]
    return Ways(
        lots[0].cofactor,
        np.vstack([ways.residual for ways in lots]),
        np.vstack([ways.leverage for ways in lots]),
        np.vstack([ways.weight for ways in lots]),
        np.concatenate([ways.square_sum for ways in lots]),
        lots[0].thresholds,
        tuple(np.concatenate([factor[n] for factor, _ in padded]) for n in range(changes)),
        tuple(np.concatenate([effect[n] for _, effect in padded]) for n in range(changes)),
    )


def _padded(ways: Ways, changes: int) -> tuple[tuple[FloatArray, ...], tuple[FloatArray, ...]]:
    """Return factors and effects of so many changes: those that are missing change nothing."""
    missing = changes - len(ways.factor)
    nothing = np.zeros(len(ways.square_sum))
    return (*ways.factor, *[nothing] * missing), (*ways.effect, *[np.zeros_like(ways.residual)] * missing)


_DOUBT = 0.01
"""Part of the square of the limit: changes after which the cost is higher by no more are doubtful, as residuals of
dozens of a-priori errors are not linear, and only an adjustment tells."""

_MOST_FOUND = 8
"""Ends that are looked at without the linearisation, at one solution."""

_LONGEST = 12

MOST_ROUNDS = 10
"""Times that changes begin again from the lowest end."""

_NEARLY = 0.1
"""Part of the square of the limit by which the cost of an end may be above the lowest one to be looked at closely."""

_HUBER, _CONVEX, _DANISH = 2.0, 20, 15
"""Residual up to which Huber's weights are 1, iterations with them, and iterations of the Danish method after these."""

_FEW, _BREAKDOWN = 60, 0.5
"""Observations that may have lost weight, and their part of all that are looked at. Beyond both the rest determines
nothing, and linear theory has left what it is good for: observations that alone held a point have come back."""

_LEAST_WEIGHT, _STEADY = 1e-10, 1e-4
"""Of an observation; and the part of a weight by which it changes at least."""


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
    limit : float
        Standard residual up to which an observation has full weight.
    rounds : int
        Most times that changes begin again.
    """
    at_start = float(begun(start, 1).costs(limit)[0])
    first = _ends(start, limit)
    best, least = _lowest_from(start, first, at_start, limit, rounds)
    elsewhere = _after_convex_weights(start, limit)
    if not _has_broken_down(elsewhere.weight):
        at_first = float(begun(elsewhere, 1).costs(limit)[0])
        other, cost = _lowest_from(elsewhere, _ends(elsewhere, limit), at_first, limit, rounds)
        best, least = (other, cost) if cost < least else (best, least)
    if least > at_start - LEAST_GAIN * limit**2 and are_many(start.weight, start.residual, limit):
        best = _settled_after_first_changes(start, limit)
    doubtful = at_start + _DOUBT * limit**2
    likely = [end.weight for end in first if end.cost < doubtful]
    # what is taken back may be far from linear, and may push out what is not
    likely.sort(key=lambda weight: bool(((weight >= 1.0) & (start.weight < 1.0)).any()))
    tried = [*_behind_others(start, at_start, limit), best.weight, *likely]
    distinct = {(weight < 1.0).tobytes(): weight for weight in reversed(tried)}
    distinct.pop((start.weight < 1.0).tobytes(), None)
    return list(distinct.values())[::-1][:_MOST_FOUND]


def _behind_others(start: LinearAdjustment, at_start: float, limit: float) -> list[FloatArray]:
    """Return the weights (c,) of lower cost to which the Danish method leads without what hides each other."""
    if not start.thresholds.most_ends:
        return []
    ends = [_settled(start, _End(np.inf, weight), limit) for weight in left_out_together(start, limit)]
    lower = [end for end in ends if end.cost < at_start - LEAST_GAIN * limit**2]
    return [end.weight for end in sorted(lower, key=itemgetter(0))[: start.thresholds.most_ends]]


def _settled_after_first_changes(start: LinearAdjustment, limit: float) -> LinearAdjustment:
    """Return the end of lowest cost to which the Danish method leads after any one of the first changes.

    Where many observations are wrong, several have to change at once, and by any one alone the cost rises.
    """
    ways, _ = first_changes(start, limit)
    lowest = min((_settled(start, _End(np.inf, weight), limit) for weight in ways.weight), key=itemgetter(0))
    return start.with_weights(lowest.weight)


def _lowest_from(
    start: LinearAdjustment, ends: list[_End], least: float, limit: float, rounds: int
) -> tuple[LinearAdjustment, float]:
    """Return where rounds of changes lead to as long as the cost falls, and the cost there."""
    best = start
    for _ in range(rounds):
        if not ends or ends[0].cost > least - LEAST_GAIN * limit**2:
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


def _ends(start: LinearAdjustment, limit: float) -> list[_End]:
    """Return where changes of one weight after the other lead to, the lowest cost first.

    The observation that is changed first stays as it is. Where the same observations have lost weight as on a way
    before, the way is given up: both go on to the same end.
    """
    ways, held = first_changes(start, limit)
    costs, ends, passed = ways.costs(limit), list[_End](), set[bytes]()
    for _ in range(_LONGEST):
        if not len(held):
            break
        numbers = np.arange(len(held))
        gains, weights = ways.gains(limit)
        gains[numbers[:, None], held] = np.inf
        rows = gains.argmin(axis=1)
        moved = ways.changed(rows, weights[numbers, rows])
        lower = moved.costs(limit)
        falls = (gains[numbers, rows] < 0.0) & (lower < costs)
        ends += map(_End, costs[~falls].tolist(), ways.weight[~falls])
        going = np.array([way for way in np.flatnonzero(falls) if _is_new(moved.weight[way], passed)], dtype=np.intp)
        ways, held, costs = moved.chosen(going), held[going], lower[going]
    ends += map(_End, costs.tolist(), ways.weight)
    ends.sort(key=itemgetter(0))
    if not are_many(start.weight, start.residual, limit):
        return ends
    nearly = ends[0].cost + _NEARLY * limit**2 if ends else 0.0
    settled = [_settled(start, end, limit) for end in ends[:_MOST_FOUND] if end.cost < nearly]
    return sorted([*settled, *ends[len(settled) :]], key=itemgetter(0))


def _settled(start: LinearAdjustment, end: _End, limit: float) -> _End:
    """Return where the Danish method leads to from an end: the other weights follow what was changed."""
    weight = end.weight
    for _ in range(_DANISH):
        size = np.abs(start.residuals_with(weight))
        weight = np.where(size > limit, np.maximum(np.exp(-size / limit), _LEAST_WEIGHT), 1.0)
        if np.array_equal(weight < 1.0, start.weight < 1.0) or _has_broken_down(weight):
            return end
    cost = start.cost_with(weight, limit)
    return _End(cost, weight) if cost < end.cost else end


def _has_broken_down(weight: FloatArray) -> bool:
    """Return whether so many of the observations (c,) have lost weight that the others say nothing."""
    return bool(np.count_nonzero(weight < 1.0) > max(_FEW, _BREAKDOWN * len(weight)))


def _is_new(weight: FloatArray, passed: set[bytes]) -> bool:
    """Return whether no way before has come to the same observations without weight, and note that one has."""
    reduced = (weight < 1.0).tobytes()
    is_new = reduced not in passed
    passed.add(reduced)
    return is_new
