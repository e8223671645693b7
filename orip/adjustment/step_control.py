"""Step control: a correction that would raise the weighted square sum by far is damped.

Near the solution, where corrections are below their standard deviations, and wherever the full correction succeeds,
nothing is damped: the iterations are those of Gauss and Newton. Damping multiplies the diagonal of the normal
equations, points included, by 1 + damping (Marquardt 1963). It changes the way to the minimum, and not the minimum:
iterations do not end with a damped correction. See docs/decisions/012.
"""

from __future__ import annotations

import numpy as np
from msgspec import Struct

from orip.adjustment.block_fit import judged_residuals
from orip.adjustment.convergence import exponent_of_numerical_precision, most_are_lost
from orip.adjustment.equations import Equations
from orip.adjustment.normals import SolvedNormals
from orip.arrays import FloatArray, parts
from orip.structs import replace
from orip.threads import by_threads

_NEAR_ENP, _FAR_ENP = 1.0, 0.0
_FIRST, _LEAST, _MOST = 1e-3, 1e-10, 1e4
_STEP = 10.0

_WORSE, _WORSE_WITH_LOSS = 1e4, 100.0
"""Multiple of the smallest mean square so far that is accepted after a full correction: along a curved valley it may
rise for some iterations. Less is accepted if observations can no longer be computed."""

_LEAST_SHARE = 0.1
"""Part of the predicted decrease that a full correction must bring after its blocks were fitted."""


class StepControl(Struct, frozen=True):
    """How strongly corrections are damped.

    Parameters
    ----------
    unknowns : int
    damping : float
        Of the next correction; 0: none.
    undamped : int
        Iterations since a correction was last refused; -1: in this one.
    least_mean_square : float
        Smallest weighted mean square of the residuals among the iterations that were judged.
    """

    unknowns: int
    damping: float = 0.0
    undamped: int = 0
    least_mean_square: float = np.inf

    def judging(self, before: Equations, weights: FloatArray, normals: SolvedNormals) -> StepControl:
        """Return the control that judges an attempt from a linearisation: it knows the mean square there."""
        if not self._judges(before, normals):
            return self
        here = _mean_square(before, weights, before.residual)
        return replace(self, least_mean_square=min(self.least_mean_square, here))

    def accepts_correction(
        self, before: Equations, after: Equations, weights: FloatArray, normals: SolvedNormals
    ) -> bool:
        """Return whether a full correction is accepted; it may raise the mean square for a while."""
        if not self._judges(before, normals):
            return True
        left = before.active & after.active
        if most_are_lost(int(np.count_nonzero(left)), int(np.count_nonzero(before.active))):
            return False
        here = _mean_square(before, weights, before.residual)
        lost = (before.active & ~left).any()
        allowed = max((_WORSE_WITH_LOSS if lost else _WORSE) * self.least_mean_square, here)
        return _mean_square(before, weights, judged_residuals(before, after)) <= allowed

    def accepts_fitted(self, before: Equations, after: Equations, weights: FloatArray, normals: SolvedNormals) -> bool:
        """Return whether a correction after which blocks were fitted is accepted; it must lower the mean square."""
        if not self._judges(before, normals):
            return True
        share = 0.0 if self.damping else _LEAST_SHARE
        required = share * normals.reduced_square_sum / _total_weight(before, weights)
        allowed = _mean_square(before, weights, before.residual) - required
        return _mean_square(before, weights, judged_residuals(before, after)) <= allowed

    def is_far(self, normals: SolvedNormals) -> bool:
        """Return whether a correction is so large that points may be anywhere."""
        return self._enp(normals) < _FAR_ENP

    @property
    def can_damp_more(self) -> bool:
        """Return whether more damping may still help."""
        return self.damping < _MOST

    def refused(self) -> StepControl:
        """Return the control after an attempt was refused."""
        return replace(self, undamped=-1)

    def relaxed(self) -> StepControl:
        """Return the control after a step was taken: the next correction is damped less, or not at all."""
        weaker = self.damping / _STEP
        return replace(self, undamped=self.undamped + 1, damping=weaker if weaker >= _LEAST else 0.0)

    def strengthened(self) -> StepControl:
        """Return the control that damps the next attempt more."""
        return replace(self, damping=_STEP * self.damping if self.damping else _FIRST)

    def _judges(self, before: Equations, normals: SolvedNormals) -> bool:
        near = self._enp(normals) >= _NEAR_ENP
        # exact constraints must be met whatever the square sum: their equations say nothing of it
        return not ((near and not self.damping) or self.damping >= _MOST or (before.active & before.exact).any())

    def _enp(self, normals: SolvedNormals) -> float:
        return exponent_of_numerical_precision(normals.reduced_square_sum, self.unknowns)


def _total_weight(before: Equations, weights: FloatArray) -> float:
    return max(float(np.where(before.active, weights, 0.0).sum()), 1.0)


def _mean_square(before: Equations, weights: FloatArray, residual: FloatArray) -> float:
    """Return the weighted mean square of residuals (n,) of what could be computed before the step."""

    def sums(part: slice) -> tuple[float, float]:
        taken, mine = np.where(before.active[part], weights[part], 0.0), residual[part]
        return float(taken.sum()), float((taken * mine) @ mine)

    total, square_sum = np.sum([(0.0, 0.0), *by_threads(sums, parts(len(residual)))], axis=0)
    return float(square_sum / max(total, 1.0))
