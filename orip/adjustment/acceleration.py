"""Acceleration of slow convergence: the last corrections tell where they are heading.

Gauss-Newton iterations on large residuals, and reweighted ones, converge linearly: each correction is about the same
part of the one before. Once corrections are smaller than the standard deviations, the step is taken to where the
sequence of corrections would end (Anderson 1965). The correction itself, by which convergence is judged, is not touched
by it, nor is the solution.
"""

from __future__ import annotations

import numpy as np

from orip.adjustment.convergence import exponent_of_numerical_precision
from orip.adjustment.equations import Layout
from orip.adjustment.normals import SolvedNormals
from orip.arrays import FloatArray

_MEMORY = 3
_STARTING_ENP = 0.0
_FAST = 1.0
"""Digits an iteration gains when it needs no help."""


class Acceleration:
    """What the last iterations did: differences of corrections, and of the steps that were taken.

    Parameters
    ----------
    layout : Layout
    """

    def __init__(self, layout: Layout) -> None:
        self._layout = layout
        self.forget()

    def forget(self) -> None:
        """Start anew, after the problem itself has changed (other weights)."""
        self._corrections: list[FloatArray] = []
        self._steps: list[FloatArray] = []
        self._enp = -np.inf

    def step(self, normals: SolvedNormals) -> FloatArray:
        """Return the step (m + 3 b,) to take for a correction.

        Parameters
        ----------
        normals : SolvedNormals
        """
        correction = normals.correction
        enp = exponent_of_numerical_precision(normals.reduced_square_sum, self._layout.unknowns)
        slow = self._enp < enp < self._enp + _FAST
        if enp < _STARTING_ENP or not slow:
            self.forget()
        self._enp = enp
        self._corrections = [*self._corrections, correction][-_MEMORY - 1 :]
        self._steps = self._steps[-(len(self._corrections) - 1) :] if len(self._corrections) > 1 else []
        if not self._steps:
            return correction
        scale = np.concatenate([normals.scale, np.ones(3 * self._layout.blocks)])
        changes = np.diff(np.array(self._corrections), axis=0)
        share, *_ = np.linalg.lstsq((changes * scale).T, correction * scale, rcond=1e-6)
        return np.asarray(correction - share @ (np.array(self._steps) + changes))

    def applied(self, step: FloatArray) -> None:
        """Remember the step that was taken."""
        self._steps = [*self._steps, step]
