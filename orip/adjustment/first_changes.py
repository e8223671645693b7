"""Which weights are changed first where the robust cost of a linear adjustment may have a lower minimum elsewhere."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from orip.adjustment.weight_changes import TESTABLE, LinearAdjustment, Ways, are_many, begun
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
