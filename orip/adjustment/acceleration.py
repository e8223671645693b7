"""Acceleration of slow convergence by the corrections of the last iterations (Anderson 1965).

Gauss-Newton iterations on large residuals, and reweighted ones, converge linearly: each correction is about the same
part of the one before. Once corrections are smaller than the standard deviations, the step goes to where the sequence
of corrections would end. Neither the correction, by which convergence is judged, nor the solution is changed by it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from msgspec import Struct

from orip.adjustment.convergence import exponent_of_numerical_precision
from orip.adjustment.equations import Layout
from orip.adjustment.normals import SolvedNormals
from orip.arrays import FloatArray
from orip.structs import replace

_MEMORY = 3
_STARTING_ENP = 0.0
_FAST = 1.0
"""Digits that an iteration gains where convergence needs no acceleration."""


class Acceleration(Struct, frozen=True):
    """The corrections of the last iterations and the steps that were taken for them; none after a change of weights.

    Parameters
    ----------
    corrections, steps : tuples of arrays (m + 3 b,)
    enp : float
        Of the last correction.
    """

    corrections: tuple[FloatArray, ...] = ()
    steps: tuple[FloatArray, ...] = ()
    enp: float = -np.inf

    def step(self, normals: SolvedNormals, layout: Layout) -> AcceleratedStep:
        """Return the step to take for the correction of an iteration."""
        correction = normals.correction
        enp = exponent_of_numerical_precision(normals.reduced_square_sum, layout.unknowns)
        slow = self.enp < enp < self.enp + _FAST
        before = self if enp >= _STARTING_ENP and slow else Acceleration()
        corrections = (*before.corrections, correction)[-_MEMORY - 1 :]
        steps = before.steps[-(len(corrections) - 1) :] if len(corrections) > 1 else ()
        history = Acceleration(corrections, steps, enp)
        if not steps:
            return AcceleratedStep(correction, history)
        scale = np.concatenate([normals.scale, np.ones(3 * layout.blocks)])
        changes = np.diff(np.array(corrections), axis=0)
        share, *_ = np.linalg.lstsq((changes * scale).T, correction * scale, rcond=1e-6)
        return AcceleratedStep(np.asarray(correction - share @ (np.array(steps) + changes)), history)

    def applied(self, step: FloatArray) -> Acceleration:
        """Return the history with the step that was taken for its last correction."""
        return replace(self, steps=(*self.steps, step))


class AcceleratedStep(NamedTuple):
    """A step (m + 3 b,), and the history with the correction that it is for."""

    step: FloatArray
    history: Acceleration
