"""Which weight function an iteration uses: a scaled one far from the solution, then that of the Danish method.

See docs/decisions/006.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from orip.adjustment.equations import Equations
from orip.adjustment.weights import danish_weights, scaled_weights
from orip.arrays import FloatArray

_SETTLED_ENP = 1.0
"""Corrections a tenth of their standard deviations: residuals no longer depend on the starting values."""

_LONGEST_SETTLING = 10
"""Iterations after which the Danish method begins in any case: with many blunders ENP may never reach that limit."""


@dataclass(frozen=True, slots=True)
class Weighing:
    """The phase of weighting that the iterations are in.

    Parameters
    ----------
    limit : float
        Standard residual above which the Danish method reduces a weight.
    start : int or None
        First iteration in which the Danish method may reduce weights; None: all weights are 1.
    settled_after : int or None
        Iterations until the residuals no longer depended on the starting values; None: they still do.
    early : bool
        Exceptionally large residuals lose weight before the Danish method; else all weights are 1 until then.
    """

    limit: float
    start: int | None
    settled_after: int | None = None
    early: bool = True

    def factors(self, equations: Equations, iteration: int) -> FloatArray:
        """Return the weight factors (n,) for an iteration; exact constraints always have 1."""
        factors = np.ones(len(equations.residual))
        if self.start is None or not (self.early or iteration >= self.start):
            return factors
        judged = equations.active & ~equations.exact
        size = np.abs(equations.residual[judged])
        danish = self.settled_after is not None and iteration >= self.start
        factors[judged] = danish_weights(size, self.limit) if danish else scaled_weights(size, self.limit)
        return factors

    def after(self, iteration: int, enp: float) -> Weighing:
        """Return the phase that follows an iteration."""
        settles = self.settled_after is None and (enp >= _SETTLED_ENP or iteration >= _LONGEST_SETTLING)
        return replace(self, settled_after=iteration) if settles else self

    def is_final_in(self, iteration: int) -> bool:
        """Return whether an iteration had the weight function that the solution has: all 1, or the Danish method."""
        return self.start is None or (self.settled_after is not None and iteration > self.iterations_before)

    @property
    def iterations_before(self) -> int:
        """Return the number of iterations before the Danish method began; 0 as long as it has not."""
        if self.start is None or self.settled_after is None:
            return 0
        return max(self.settled_after, self.start - 1)


def weighing_from(limit: float, start: int | None, *, early: bool) -> Weighing:
    """Return the phase to begin with; without early weights the Danish method waits for nothing but its iteration."""
    return Weighing(limit, start) if early or start is None else Weighing(limit, start, start - 1, early=False)
