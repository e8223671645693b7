"""Solving a block: the iterations and the precision of what they find."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from orip.adjustment.iteration import Adjusted, IterationSettings, PassRecord, adjust
from orip.adjustment.precision import Cofactors, VarianceOfUnitWeight, cofactors, variance_of_unit_weight
from orip.bundle.problem import BlockProblem, pose_problem, starting_state
from orip.bundle.state import State
from orip.errors import NotSolvableError
from orip.progress import stage
from orip.records.block import Block
from orip.records.project import BundleDefinition

_LARGE = 2000
"""Unknowns of a full reduced system that several threads factor faster than one."""


@dataclass(frozen=True, slots=True)
class SolvedBlock:
    """A block with its adjustment and the precision of everything in it."""

    block: Block
    problem: BlockProblem
    adjusted: Adjusted[State]
    cofactors: Cofactors
    variance: VarianceOfUnitWeight

    @property
    def deviation_scale(self) -> float:
        """Return what the root of a cofactor is multiplied with: sigma0, or 1 without redundancy."""
        return self.variance.sigma0 if np.isfinite(self.variance.sigma0) else 1.0

    def cofactors_of(self, columns: NDArray[np.int64]) -> NDArray[np.float64]:
        """Return the cofactor matrix (k, k) of unknowns that are all in the reduced system or all of one point."""
        m = self.problem.layout.reduced
        if (columns < m).all():
            return np.asarray(self.cofactors.reduced[np.ix_(columns, columns)])
        place = (columns - m) % 3
        return np.asarray(self.cofactors.blocks[(columns[0] - m) // 3][np.ix_(place, place)])


def iteration_settings(definition: BundleDefinition) -> IterationSettings:
    """Return the settings of the iterations; down-weighting that starts at the last iteration is off."""
    off = definition.start_down_weight >= definition.max_iterations
    return IterationSettings(
        definition.enp_stop,
        definition.max_iterations,
        definition.max_standard_residual,
        None if off else definition.start_down_weight,
        definition.max_lost_digits,
    )


def solve_block(block: Block, on_pass: Callable[[PassRecord], None], stop_asked: Callable[[], bool]) -> SolvedBlock:
    """Adjust a block.

    Parameters
    ----------
    block : Block
    on_pass : callable
        Called after each iteration.
    stop_asked : callable
        Asked after each iteration; True stops there.

    Returns
    -------
    SolvedBlock

    Raises
    ------
    NotSolvableError
        When there are no unknowns or no observations, or the numbers have run away.
    """
    problem = pose_problem(block)
    if not problem.layout.unknowns:
        message = "nothing is unknown: every camera, photo and point is constant; there is nothing to adjust"
        raise NotSolvableError(message)
    settings = iteration_settings(block.definition)
    return solve_problem(block, problem, starting_state(block), settings, on_pass, stop_asked)


def solve_problem(
    block: Block,
    problem: BlockProblem,
    start: State,
    settings: IterationSettings,
    on_pass: Callable[[PassRecord], None],
    stop_asked: Callable[[], bool],
) -> SolvedBlock:
    """Adjust a block's problem from any state; see `solve_block`."""
    with threads_that_pay(problem):
        with stage("adjusting"):
            adjusted = adjust(problem, start, settings, on_pass, stop_asked)
        return _solved(block, problem, adjusted)


def threads_that_pay(problem: BlockProblem) -> AbstractContextManager[object]:
    """Return a context in which only large full matrices have more than one thread: with others they only wait."""
    from threadpoolctl import threadpool_limits

    layout = problem.layout
    full = layout.arrangement is None and layout.reduced >= _LARGE
    return nullcontext() if full else threadpool_limits(1, user_api="blas")


def _solved(block: Block, problem: BlockProblem, adjusted: Adjusted[State]) -> SolvedBlock:
    """Return an adjusted block with its precision."""
    equations = adjusted.linearised.equations
    if not np.isfinite(adjusted.passes[-1].enp) or not np.isfinite(equations.residual).all():
        message = (
            "the adjustment ran away to numbers that are not finite; check the preliminary values, "
            "the control and the a-priori errors"
        )
        raise NotSolvableError(message)
    with stage("precision"):
        found = cofactors(equations, adjusted.normals)
        if problem.datum is not None:
            state = adjusted.linearised.state
            found = problem.datum.transformed_cofactors(found, adjusted.normals, state, problem.unknowns)
    effective = problem.layout.unknowns - int(np.count_nonzero(adjusted.normals.removed))
    variance = variance_of_unit_weight(equations, adjusted.weight_factors, found.leverage, effective)
    return SolvedBlock(block, problem, adjusted, found, variance)
