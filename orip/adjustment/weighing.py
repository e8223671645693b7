"""Which weights an iteration has: while the state is still far off, only what sticks out of all others loses weight."""

from __future__ import annotations

import numpy as np

from orip.adjustment.equations import Equations
from orip.adjustment.weights import danish_weights, settling_weights
from orip.arrays import FloatArray

_SETTLED_ENP = 1.0
"""Corrections a tenth of their deviations: residuals are now those of the observations, and no longer of the start."""

_LONGEST_SETTLING = 10
"""Iterations after which weights are reduced in any case: where blunders change sides, the state may never settle."""


class Weighing:
    """The weights of an adjustment's iterations, from the first to the last.

    Parameters
    ----------
    limit : float
        Standard residual above which the Danish method reduces a weight.
    start : int or None
        First iteration that may have reduced weights; None: they are never reduced.

    Attributes
    ----------
    settled : bool
        The state is no longer far off.
    settled_after : int
        Iterations that this took.
    """

    def __init__(self, limit: float, start: int | None) -> None:
        self._limit, self._start = limit, start
        self.settled = start is None
        self.settled_after = 0

    def factors(self, equations: Equations, iteration: int) -> FloatArray:
        """Return the weight factors (n,) for an iteration; what must be met exactly has always 1."""
        factors = np.ones(len(equations.residual))
        if self._start is None:
            return factors
        judged = equations.active & ~equations.exact
        size = np.abs(equations.residual[judged])
        begun = self.settled and iteration >= self._start
        factors[judged] = danish_weights(size, self._limit) if begun else settling_weights(size, self._limit)
        return factors

    def after(self, iteration: int, enp: float) -> None:
        """Take note of how far off the state still was in an iteration."""
        if not self.settled and (enp >= _SETTLED_ENP or iteration >= _LONGEST_SETTLING):
            self.settled, self.settled_after = True, iteration

    def had_begun(self, iteration: int) -> bool:
        """Return whether the weights of an iteration were those that remain: all 1, or the reduced ones."""
        return self._start is None or (self.settled and iteration > self.began_after)

    @property
    def began_after(self) -> int:
        """Return the iterations before weights were reduced; 0 as long as they are not."""
        return max(self.settled_after, self._start - 1) if self._start is not None and self.settled else 0
