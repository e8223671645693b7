"""What controls the iterations of an adjustment, what one of them hands to the next, and what is printed of each."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Generic, NamedTuple

from msgspec import Struct

from orip.adjustment.convergence import Acceleration
from orip.adjustment.equations import Linearised, StateT
from orip.adjustment.step_control import StepControl
from orip.adjustment.weights import LEAST_WEIGHT, Weighing
from orip.arrays import FloatArray, IntArray


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
