"""What controls the iterations of an adjustment, what one of them hands to the next, and what is printed of each.

Near the solution normal equations serve for one more correction, with misclosures of the state there. The corrections
of Gauss and Newton become smaller so quickly there that the last one mostly shows only that nothing is left to correct.
For that the right-hand side has to be new, not the matrix (simplified Newton; Deuflhard 2011): it is the same solution,
for a pass over the observations in place of the formation and factorisation of normal equations.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Generic, NamedTuple

import numpy as np
from msgspec import Struct

from orip.adjustment.convergence import Acceleration, StepControl
from orip.adjustment.equations import Equations, Layout, Linearised, StateT
from orip.adjustment.normals import SolvedNormals
from orip.adjustment.weights import LEAST_WEIGHT, Weighing
from orip.arrays import FloatArray, IntArray
from orip.structs import replace


class IterationSettings(Struct, frozen=True):
    """What controls the iterations.

    Parameters
    ----------
    enp_stop : float
    max_iterations : int
    max_standard_residual : float
        Above it the Danish method reduces a weight.
    start_down_weight : int or None
        First iteration in which it may; None: all weights are 1.
    max_lost_digits : float
    early_weights : bool
        Exceptionally large residuals lose weight before the Danish method, which waits until the block has settled;
        else all weights are 1 before it, and it begins at `start_down_weight`.
    most_attempts : int
        Attempts to improve the solution that is found first.
    is_small : callable or None
        Tells of the states before and after an iteration and its weight factors (n,) whether these may be the last;
        None: ENP tells.
    """

    enp_stop: float
    max_iterations: int
    max_standard_residual: float
    start_down_weight: int | None
    max_lost_digits: float
    early_weights: bool = True
    most_attempts: int = 12
    is_small: Callable[[Linearised[Any], Linearised[Any], FloatArray], bool] | None = None


class IterationRecord(Struct, frozen=True):
    """One printed line: see `orip.records.results.solution.IterationPass`; sigma0 is that after the iteration.

    `active` is the number of observations that can be computed; `is_small` what `IterationSettings.is_small` said.
    """

    iteration: int
    enp: float
    sigma0: float
    down_weighted: int
    singular: int
    step_limited: bool
    active: int
    is_small: bool = True


class Candidate(NamedTuple, Generic[StateT]):
    """A state that may be nearer to a better solution.

    Attributes
    ----------
    state : state of the problem
    full_weight, no_weight : arrays of int
        Observations that have full weight, or none, in the next iterations.
    is_lower : bool
        Whether the cost is lower there already.
    """

    state: StateT
    full_weight: IntArray
    no_weight: IntArray
    is_lower: bool

    def applied(self, weights: FloatArray) -> FloatArray:
        """Return the weights (n,) of these iterations."""
        exchanged = weights.copy()
        exchanged[self.full_weight] = 1.0
        exchanged[self.no_weight] = LEAST_WEIGHT
        return exchanged


class Tried(Struct, Generic[StateT], frozen=True):
    """What has been tried to improve a solution.

    Parameters
    ----------
    attempts : int
    exchanges : tuple of Candidate or None
        Exchanges still to be tried at the present solution; None: they have not been looked for.
    consensus, hidden : bool
        Whether it, and what hides behind other observations, was looked for at the present solution.
    """

    attempts: int = 0
    exchanges: tuple[Candidate[StateT], ...] | None = None
    consensus: bool = False
    hidden: bool = False


class IterationState(Struct, Generic[StateT], frozen=True):
    """All that one iteration hands to the next.

    Parameters
    ----------
    current : Linearised
        The state with its observation equations.
    weighing : Weighing
    control : StepControl
    acceleration : Acceleration
    tried : Tried
    exchange : Candidate or None
        Whose weights the next iteration has.
    attempted_from : IterationState or None
        The solution that the iterations try to improve.
    had_converged : bool
        The iterations have gone back to a solution that had converged.
    records : tuple of IterationRecord
        Of the iterations so far.
    """

    current: Linearised[StateT]
    weighing: Weighing
    control: StepControl
    acceleration: Acceleration
    tried: Tried[StateT] = Tried()
    exchange: Candidate[StateT] | None = None
    attempted_from: IterationState[StateT] | None = None
    had_converged: bool = False
    records: tuple[IterationRecord, ...] = ()


_WORTH_IT = 20_000
"""Observations from which normal equations are held: below, an iteration takes a few milliseconds."""

_NEAR_ENP, _NEXT_GAIN = 0.5, 1.5
"""ENP from which they are held; and how many times the digits of the last correction the next one gains."""

_SAME_PLACE_ENP = 3.0
"""ENP of a correction from which normal equations before it are those after it: it is a thousandth of the standard
deviations, and changes partials by less than the rounding of printed figures."""

_SAME_MATRIX_DIGITS = 3.5
"""Digits that a correction with held normal equations gains where these are those of the solution too: what is left of
a correction shows by what part the matrix has changed with it."""


class FormedNormals(Struct, Generic[StateT], frozen=True):
    """The normal equations of an iteration.

    Parameters
    ----------
    at : Linearised
        Where they were formed.
    normals : SolvedNormals
    weights : array (n,)
        Weight factors.
    served_before : bool
        The last correction is not the first one with them.
    """

    at: Linearised[StateT]
    normals: SolvedNormals
    weights: FloatArray
    served_before: bool = False

    def have_weights(self, equations: Equations, weights: FloatArray) -> bool:
        """Return whether other equations have the same weights (n,), those of inactive observations aside."""
        mine = self.at.equations.effective(self.weights)
        return bool(np.array_equal(mine, equations.effective(weights)))

    def solved_again(self, equations: Equations, layout: Layout) -> FormedNormals[StateT]:
        """Return them with the correction at another linearisation."""
        roots = np.sqrt(equations.effective(self.weights))
        misclosure = -roots * np.where(equations.active, equations.residual, 0.0)
        normals = self.normals.with_right_side(equations.rows.right_side(roots, misclosure, layout))
        return replace(self, normals=normals, served_before=True)

    def are_of_solution(self, records: tuple[IterationRecord, ...]) -> bool:
        """Return whether they are the normal equations where the last of the iterations ended, within rounding."""
        last = records[-1].enp
        if self.served_before:
            before = records[-2].enp
            return before >= _SAME_PLACE_ENP or last - before >= _SAME_MATRIX_DIGITS
        return last >= _SAME_PLACE_ENP


def will_do(formed: FormedNormals[StateT], records: tuple[IterationRecord, ...], enp_stop: float) -> bool:
    """Return whether the normal equations of the last iteration are enough for what is probably the last correction."""
    equations = formed.at.equations
    if (
        formed.served_before
        or equations.has_exact_constraints
        or len(records) < 2
        or len(equations.residual) < _WORTH_IT
    ):
        return False
    last = records[-1].enp
    next_gain = _NEXT_GAIN * (last - records[-2].enp)
    # else they would have to be formed at the end all the same
    are_of_next = last >= _SAME_PLACE_ENP or next_gain >= _SAME_MATRIX_DIGITS
    return last >= _NEAR_ENP and last + next_gain >= enp_stop and are_of_next
