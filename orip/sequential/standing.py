"""How the equations of an observation fit: residuals, redundancy numbers, and the fall of the square sum without it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from orip.arrays import FloatArray

LEAST_REDUNDANCY = 1e-4
"""Below this redundancy number an observation is not taken out of the triangle, which would lose more than four digits
(of sixteen, as -log10 r are lost): it is built again."""


class Standing(NamedTuple):
    """How k equations of an observation fit, all others being in; or as they would fit if they were in.

    Attributes
    ----------
    residual : array (k,)
        Computed minus observed, divided by the a-priori errors.
    cofactor : array (k, k)
        Of the residuals; its diagonal has the redundancy numbers.
    """

    residual: FloatArray
    cofactor: FloatArray

    @property
    def redundancy(self) -> FloatArray:
        """Return the redundancy numbers (k,), from 0 to 1."""
        return np.clip(np.diagonal(self.cofactor), 0.0, 1.0)

    def normalised(self, least_redundancy: float = LEAST_REDUNDANCY) -> FloatArray:
        """Return Baarda's w (k,) with sigma0 = 1; NaN where nothing checks an equation."""
        checked = self.redundancy > least_redundancy
        return np.where(checked, self.residual / np.sqrt(np.where(checked, self.redundancy, 1.0)), np.nan)

    def square(self, least_redundancy: float = LEAST_REDUNDANCY) -> tuple[float, int]:
        """Return by how much the square sum falls without the observation, and how many equations are checked."""
        values, vectors = np.linalg.eigh(self.cofactor)
        checked = values > least_redundancy
        parts = (vectors.T @ self.residual)[checked]
        return float(np.sum(parts**2 / values[checked])), int(np.count_nonzero(checked))
