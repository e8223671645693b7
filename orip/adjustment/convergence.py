"""When to stop, and the acceleration of slow convergence by the corrections of the last iterations (Anderson 1965)."""

from __future__ import annotations

from collections.abc import Sequence
from enum import Enum
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from orip.adjustment.equations import Layout
from orip.adjustment.normals import SolvedNormals
from orip.arrays import FloatArray, parts
from orip.structs import replace
from orip.threads import by_threads

ENP_LIMIT = 15.0
"""Printed for corrections that are zero to working precision."""

_WEIGHT_CHANGE = 0.05

_LEAST_COMPUTABLE = 0.5
"""Diverged once less than this part of the observations can be computed."""

_FALLING_ITERATIONS = 3
_FALLEN_DIGITS = 3.0
"""Diverged once corrections are a thousand times as large as the first ones."""


class TerminationReason(Enum):
    """Why the iterations ended."""

    CONVERGED = "converged"
    MAX_ITERATIONS = "not converged within the allowed iterations"
    DIVERGED = "diverged"
    STOPPED = "stopped by the operator"


def exponent_of_numerical_precision(reduced_square_sum: float, unknowns: int) -> float:
    """Return ENP = -1/2 log10(dx^T N dx / u): the digits by which corrections undercut their standard deviations.

    Parameters
    ----------
    reduced_square_sum : float
        dx^T N dx, the square sum of the reduced right-hand side.
    unknowns : int
        Unknowns that took part.

    Notes
    -----
    Krarup (1982) introduced the measure; the formula is this program's reading of it (docs/decisions).
    """
    if not np.isfinite(reduced_square_sum):
        return -np.inf
    mean = reduced_square_sum / max(unknowns, 1)
    return ENP_LIMIT if mean < 10.0 ** (-2.0 * ENP_LIMIT) else float(-0.5 * np.log10(mean))


def weights_are_steady(before: NDArray[np.float64], after: NDArray[np.float64]) -> bool:
    """Return whether no weight factor changes by more than 0.05 from one iteration to the next."""

    def is_steady(part: slice) -> bool:
        return bool(np.abs(after[part] - before[part]).max() <= _WEIGHT_CHANGE)

    return all(by_threads(is_steady, parts(len(after))))


def is_diverging(enps: Sequence[float]) -> bool:
    """Return whether corrections grow: by the ENP of successive iterations with the same weight function.

    That is where ENP fell in three successive iterations and is negative, is three digits below the first one (or below
    zero), or is not finite. A positive ENP says that corrections are smaller than the standard deviations; it may fall
    for some iterations while weights change from one solution to another.
    """
    if enps and not np.isfinite(enps[-1]):
        return True
    if enps and enps[-1] < min(enps[0], 0.0) - _FALLEN_DIGITS:
        return True
    last = enps[-_FALLING_ITERATIONS - 1 :]
    return len(last) > _FALLING_ITERATIONS and last[-1] < 0.0 and all(b < a for a, b in pairwise(last))


def most_are_lost(computable: int, at_first: int) -> bool:
    """Return whether too few of the observations that could be computed at first can be computed now."""
    return computable < _LEAST_COMPUTABLE * at_first


# Gauss-Newton iterations on large residuals, and reweighted ones, converge linearly: each correction is about the same
# part of the one before. Once corrections are smaller than the standard deviations, the step goes to where the sequence
# of corrections would end. Neither the correction, by which convergence is judged, nor the solution is changed by it.

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
