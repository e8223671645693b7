"""The search for weights with which the robust cost of a linear adjustment is lower: changes of one after the other."""

from __future__ import annotations

from operator import itemgetter
from typing import NamedTuple

import numpy as np

from orip.adjustment.first_changes import first_changes, left_out_together
from orip.adjustment.weight_changes import LEAST_GAIN, LinearAdjustment, are_many, begun
from orip.arrays import FloatArray

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
    start : LinearAdjustment
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
    cost = float(begun(start.with_weights(weight), 1).costs(limit)[0])
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
