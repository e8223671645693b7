"""The Danish method: weights that fall with the standard residual, decided anew after each iteration.

Krarup, Juhl and Kubik (1980) gave the principle. The function used here, exp(-u / c) above the limit c, is this
program's choice among those found under that name: it does not diverge where the steeper ones do.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

_FLOOR = 1e-30
"""A removed observation never makes an exact zero on the diagonal."""


@dataclass(frozen=True, slots=True)
class DanishWeights:
    """When and how weights are reduced.

    Parameters
    ----------
    max_standard_residual : float
        c; observations up to it keep their weight.
    start : int
        Iteration at which down-weighting starts; more than the number of iterations: never.
    """

    max_standard_residual: float
    start: int

    def factors(self, standard_residuals: FloatArray, iteration: int) -> FloatArray:
        """Return the weight factors (0, 1] for an iteration.

        Parameters
        ----------
        standard_residuals : array (n,)
            |v| / a-priori error after the iteration before.
        iteration : int
            Counted from 1.

        Returns
        -------
        array (n,)
        """
        if iteration < self.start:
            return np.ones(len(standard_residuals))
        c = self.max_standard_residual
        reduced = np.maximum(np.exp(-standard_residuals / c), _FLOOR)
        return np.where(standard_residuals <= c, 1.0, reduced)
