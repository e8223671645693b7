"""Changes of weights in a linear adjustment: what the robust cost becomes, without adjusting again.

With cofactors H = A Q A^T of the adjusted observations, a change d of the weight of observation i changes the residuals
by -H_i g v_i with g = d / (1 + d h_i), the cofactors by -g H_i H_i^T and the weighted square sum by g v_i^2. Several
changes D at once change them by -H_p K v_p, -H_p K H_p^T and v_p^T K v_p, with K = (D^-1 + H_pp)^-1 (Sherman, Morrison
and Woodbury).
"""

from __future__ import annotations

import numpy as np
from msgspec import Struct

from orip.adjustment.weights import danish_costs
from orip.arrays import BoolArray, FloatArray, IntArray

LEAST_GAIN = 0.0005
"""Part of the square of the limit by which the cost has to fall."""

TESTABLE = 0.03
"""Least redundancy number of an observation that may lose its weight."""

_LEAST_FACTOR = 1e-3
"""By which a residual is divided where its weight changes."""


class Thresholds(Struct, frozen=True):
    """What may be changed in a search for a lower cost.

    Parameters
    ----------
    doubtful : float
        Part of the limit above which the residual of an observation has to be for it to lose its weight; half, or its
        redundancy number where that is less, but not less than this.
    determinant : float
        Least determinant of the redundancy of two observations that lose their weights together.
    most_pairs : int
        Most pairs of these.
    most_ends : int
        Most ends, without such pairs and what fits least then, that are looked at without the linearisation.
    """

    doubtful: float
    determinant: float
    most_pairs: int
    most_ends: int

    def residuals(self, redundancy: FloatArray, limit: float) -> FloatArray:
        """Return the residuals above which observations with these redundancy numbers may lose their weight."""
        return limit * np.clip(redundancy, self.doubtful, 0.5)


ORDINARY = Thresholds(0.5, TESTABLE**2, 16, 0)

HIDDEN = Thresholds(0.0, 1e-5, 100, 4)
"""At the end: what has a small residual because it determines something nearly alone, or behind others like it."""


class LinearAdjustment(Struct, frozen=True):
    """c observations of a linear adjustment.

    Parameters
    ----------
    cofactor : array (c, c)
        H.
    residual, weight : arrays (c,)
    square_sum : float
        Weighted square sum of all observations of the adjustment, these and others.
    thresholds : Thresholds
    """

    cofactor: FloatArray
    residual: FloatArray
    weight: FloatArray
    square_sum: float
    thresholds: Thresholds = ORDINARY

    def residuals_with(self, weights: FloatArray) -> FloatArray:
        """Return the residuals (c,) with other weights (c,)."""
        return self._with(weights)[0]

    def cost_with(self, weights: FloatArray, limit: float) -> float:
        """Return the robust cost with other weights (c,)."""
        residual, square_sum = self._with(weights)
        return float(_costs(weights[None], residual[None], np.array([square_sum]), limit)[0])

    def _with(self, weights: FloatArray) -> tuple[FloatArray, float]:
        """Return residuals and square sum with other weights (c,)."""
        places = np.flatnonzero(weights != self.weight)
        columns, residual = self.cofactor[:, places], self.residual[places]
        pull = np.linalg.solve(np.diag(1.0 / (weights - self.weight)[places]) + columns[places], residual)
        return np.asarray(self.residual - columns @ pull), self.square_sum + float(residual @ pull)

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
            self.thresholds,
        )


class Ways(Struct, frozen=True):
    """s ways of changing the weights of c observations, one after the other, after k changes.

    Parameters
    ----------
    cofactor : array (c, c)
        H before the changes.
    residual, leverage, weight : arrays (s, c)
        v, the diagonal of H, and the weights after them.
    square_sum : array (s,)
    thresholds : Thresholds
    factor, effect : tuples of k arrays (s,), (s, c)
        g and H_i of the changes.
    """

    cofactor: FloatArray
    residual: FloatArray
    leverage: FloatArray
    weight: FloatArray
    square_sum: FloatArray
    thresholds: Thresholds
    factor: tuple[FloatArray, ...] = ()
    effect: tuple[FloatArray, ...] = ()

    def chosen(self, ways: IntArray | BoolArray) -> Ways:
        """Return some of the ways; one may be chosen several times."""
        return Ways(
            self.cofactor, self.residual[ways], self.leverage[ways], self.weight[ways], self.square_sum[ways],
            self.thresholds,
            tuple(factor[ways] for factor in self.factor), tuple(effect[ways] for effect in self.effect),
        )  # fmt: skip

    def changed(self, rows: IntArray, weights: FloatArray) -> Ways:
        """Return the ways after one more change: the observations `rows` (s,) get `weights` (s,)."""
        ways = np.arange(len(rows))
        column = self.cofactor[rows]
        for before, effect in zip(self.factor, self.effect, strict=True):
            column = column - (before * effect[ways, rows])[:, None] * effect
        change = weights - self.weight[ways, rows]
        factor = change / (1.0 + change * column[ways, rows])
        after = self.weight.copy()
        after[ways, rows] = weights
        return Ways(
            self.cofactor,
            self.residual - (factor * self.residual[ways, rows])[:, None] * column,
            self.leverage - factor[:, None] * column**2,
            after,
            self.square_sum + factor * self.residual[ways, rows] ** 2,
            self.thresholds,
            (*self.factor, factor),
            (*self.effect, column),
        )

    def costs(self, limit: float) -> FloatArray:
        """Return the robust costs (s,)."""
        return _costs(self.weight, self.residual, self.square_sum, limit)

    def gains(self, limit: float) -> tuple[FloatArray, FloatArray]:
        """Return the change (s, c) of the cost by changing each observation, and the weights (s, c) that it has then.

        One that has lost weight is taken back; one whose residual is large enough loses its weight. What
        the others contribute to the cost is taken as unchanged. Infinite for all that cannot be changed.
        """
        weights, gains = self._other_weights(limit), np.full(self.weight.shape, np.inf)
        # cofactors of hundreds of changes may have lost all digits
        factors = 1.0 + (weights - self.weight) * self.leverage
        places = np.nonzero((weights != self.weight) & (factors > _LEAST_FACTOR))
        now, then, residual = self.weight[places], weights[places], self.residual[places]
        factor = factors[places]
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
        free = 1.0 - self.leverage
        is_large = np.abs(self.residual) > self.thresholds.residuals(free, limit)
        in_use = (self.weight >= 1.0) & is_large & (free > TESTABLE)
        places = np.nonzero(in_use)
        size, leverage = np.abs(self.residual[places]), self.leverage[places]
        weight = np.zeros(len(size))
        for _ in range(3):
            moved = size / (1.0 - (1.0 - weight) * leverage)
            weight = np.where(moved > limit, np.exp(-moved / limit), 0.0)
        weights[places] = weight
        return weights


def _costs(weight: FloatArray, residual: FloatArray, square_sum: FloatArray, limit: float) -> FloatArray:
    """Return robust costs (s,) from weights and residuals (s, c) and square sums (s,): half the latter where these fit.

    Infinite where the square sum has come to less than the part of some observations. The cofactors are those of the
    iteration before: their small errors count more than all else where a residual of thousands of a-priori errors is
    taken back.
    """
    ways, places = np.nonzero((weight < 1.0) | (np.abs(residual) > limit))
    residual = residual[ways, places]
    of_others = square_sum - np.bincount(ways, weight[ways, places] * residual**2, len(square_sum))
    costs = of_others / 2.0 + np.bincount(ways, danish_costs(np.abs(residual), limit), len(square_sum))
    return np.where(of_others >= -LEAST_GAIN * limit**2, costs, np.inf)


def begun(start: LinearAdjustment, ways: int) -> Ways:
    """Return so many ways on which nothing has been changed yet."""

    def repeated(values: FloatArray) -> FloatArray:
        return np.repeat(values[None], ways, axis=0)

    leverage = np.diag(start.cofactor)
    residual, weight = repeated(start.residual), repeated(start.weight)
    square_sum = np.full(ways, start.square_sum)
    return Ways(start.cofactor, residual, repeated(leverage), weight, square_sum, start.thresholds)


_MANY = 8
"""Observations that have lost weight, from which on several may have to change at once."""

_OF_ANOTHER_KIND = 1e4
"""Times the limit: what is further off was not misread, but given in another unit or system."""


def are_many(weight: FloatArray, residual: FloatArray, limit: float) -> bool:
    """Return whether so many observations (c,) have lost weight that what hides behind others is looked for."""
    return int(np.count_nonzero((weight < 1.0) & (np.abs(residual) < _OF_ANOTHER_KIND * limit))) >= _MANY
