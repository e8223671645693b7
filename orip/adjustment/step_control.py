"""Step control: a correction that would raise the weighted square sum by far is damped.

Near the solution, where corrections are below their standard deviations, and wherever the full correction leads on,
nothing is damped and nothing is spent: the iterations are those of Gauss and Newton. Damping multiplies the diagonal of
the normal equations, points included, by 1 + damping (Marquardt 1963). It changes the way to the minimum, and not the
minimum: iterations do not end with a damped correction.
"""

from __future__ import annotations

import numpy as np

from orip.adjustment.block_fit import judged_residuals
from orip.adjustment.convergence import exponent_of_numerical_precision
from orip.adjustment.equations import Equations, Layout
from orip.adjustment.normals import SolvedNormals
from orip.arrays import FloatArray

_NEAR_ENP, _FAR_ENP = 1.0, 0.0
_FIRST, _LEAST, _MOST = 1e-3, 1e-10, 1e4
_STEP = 10.0
_WORSE, _WORSE_WITH_LOSS = 1e4, 100.0
"""Times the least mean square so far: a step along a curved valley may raise it for a while; less is allowed to one
after which observations can no longer be computed."""


_LEAST_SHARE = 0.1
"""Of the predicted decrease that a full correction has to bring whose blocks had to be placed; a damped one will bring
more."""


class StepControl:
    """How strongly corrections are damped, from one iteration to the next.

    Parameters
    ----------
    layout : Layout

    Attributes
    ----------
    damping : float
        Of the next correction; 0: none.
    undamped : int
        Iterations since a correction was last refused.
    """

    def __init__(self, layout: Layout) -> None:
        self._unknowns = layout.unknowns
        self._least = np.inf
        self.damping = 0.0
        self.undamped = 0

    def accepts(
        self, before: Equations, after: Equations, weights: FloatArray, normals: SolvedNormals, *, full: bool
    ) -> bool:
        """Return whether a step is taken; one that is not the full correction alone must lower the mean square.

        Parameters
        ----------
        before, after : Equations
        weights : array (n,)
            Weight factors of the iteration.
        normals : SolvedNormals
        """
        near = self._enp(normals) >= _NEAR_ENP
        # constants are met at any price: their equations say nothing of the square sum
        if (near and not self.damping) or self.damping >= _MOST or (before.active & before.exact).any():
            return True
        taken = np.where(before.active, weights, 0.0)
        total = max(float(taken.sum()), 1.0)
        here = float(taken @ before.residual**2) / total
        self._least = min(self._least, here)
        lost = (before.active & ~after.active).any()
        worse = _WORSE_WITH_LOSS if lost else _WORSE
        share = 0.0 if self.damping else _LEAST_SHARE
        allowed = max(worse * self._least, here) if full else here - share * normals.reduced_square_sum / total
        leads_on = float(taken @ judged_residuals(before, after) ** 2) / total <= allowed
        if not leads_on:
            self.undamped = -1
        return leads_on

    def is_far(self, normals: SolvedNormals) -> bool:
        """Return whether a correction is so large that points may be anywhere."""
        return self._enp(normals) < _FAR_ENP

    def _enp(self, normals: SolvedNormals) -> float:
        return exponent_of_numerical_precision(normals.reduced_square_sum, self._unknowns)

    def weaken(self) -> None:
        """Damp the next correction less than this one, or not at all."""
        self.undamped += 1
        weaker = self.damping / _STEP
        self.damping = weaker if weaker >= _LEAST else 0.0

    def strengthen(self) -> None:
        """Damp the next attempt more."""
        self.damping = _STEP * self.damping if self.damping else _FIRST
