"""What controls the iterations of an adjustment, what one of them hands to the next, and what is printed of each."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Generic

from orip.adjustment.acceleration import Acceleration
from orip.adjustment.equations import Linearised, StateT
from orip.adjustment.exchanges import Exchange
from orip.adjustment.step_control import StepControl
from orip.adjustment.weighing import Weighing


@dataclass(frozen=True, slots=True)
class IterationSettings:
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
    """

    enp_stop: float
    max_iterations: int
    max_standard_residual: float
    start_down_weight: int | None
    max_lost_digits: float
    early_weights: bool = True


@dataclass(frozen=True, slots=True)
class IterationRecord:
    """One printed line: see `orip.records.results.solution.IterationPass`; sigma0 is that after the iteration.

    `active` is the number of observations that can be computed.
    """

    iteration: int
    enp: float
    sigma0: float
    down_weighted: int
    singular: int
    step_limited: bool
    active: int


@dataclass(frozen=True, slots=True)
class Tried:
    """What has been tried from converged solutions.

    Parameters
    ----------
    attempts : int
    exchange, consensus : bool
        Whether it was looked for at the present solution.
    """

    attempts: int = 0
    exchange: bool = False
    consensus: bool = False


@dataclass(frozen=True, slots=True)
class IterationState(Generic[StateT]):
    """All that one iteration hands to the next.

    Parameters
    ----------
    current : Linearised
        The state with its observation equations.
    weighing : Weighing
    control : StepControl
    acceleration : Acceleration
    tried : Tried
    exchange : Exchange or None
        Observations that have full weight, or none, in the next iteration.
    converged : IterationState or None
        The converged solution that the iterations try to improve.
    returned : bool
        An attempt was taken back: the solution is a converged one.
    records : tuple of IterationRecord
        Of the iterations so far.
    """

    current: Linearised[StateT]
    weighing: Weighing
    control: StepControl
    acceleration: Acceleration
    tried: Tried = Tried()
    exchange: Exchange | None = None
    converged: IterationState[StateT] | None = None
    returned: bool = False
    records: tuple[IterationRecord, ...] = ()
