"""A-priori errors estimated group by group: a block is adjusted again with them until they no longer change."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from msgspec import Struct
from scipy.special import gammainc, gammaincc

from orip.adjustment.iteration_state import IterationRecord, IterationSettings
from orip.arrays import BoolArray, FloatArray
from orip.bundle.problem import BlockProblem, pose_problem
from orip.bundle.solve import SolvedBlock, solve_problem
from orip.bundle.variance_components.helmert import VarianceEquations, variance_equations
from orip.bundle.variance_components.variance_groups import (
    GroupRows,
    VarianceGroup,
    variance_groups,
    with_errors_times,
)
from orip.records.block import Block
from orip.records.results.variance_component import VarianceComponent
from orip.structs import replace

_MOST_ADJUSTMENTS = 20
_SETTLED, _SETTLED_TO_DEVIATION = 1e-3, 0.02
"""Change of a variance at which it is found: as part of it, or of its standard deviation where that is more."""

_LEAST_VARIANCE = 1e-4
"""The estimate of errors that do not differ from zero is not followed further."""

_LEAST_REDUNDANCY = 1.0
"""Of a group that is estimated: with less, hardly anything would be known of its errors."""

_LEAST_TO_BEGIN = 0.02
"""Errors that are given far too small hide the redundancy that the group will have."""


class EstimatedErrors(NamedTuple):
    """The block as adjusted with the estimated errors, and the variance components."""

    solved: SolvedBlock
    components: tuple[VarianceComponent, ...]


def estimate_errors(
    solved: SolvedBlock,
    settings: IterationSettings,
    on_iteration: Callable[[IterationRecord], None],
    stop_asked: Callable[[], bool],
    pose: Callable[[Block], BlockProblem] = pose_problem,
) -> EstimatedErrors:
    """Estimate the a-priori errors of all groups of observations, and adjust the block with them.

    Parameters
    ----------
    solved : SolvedBlock
        The block as adjusted with the given a-priori errors.
    settings : IterationSettings
        Of that adjustment and the further ones.
    on_iteration, stop_asked : callable
        See `orip.bundle.solve.solve_block`.
    pose : callable
        Returns the problem of a block, as a whole or divided.

    Returns
    -------
    EstimatedErrors
        The block as it was where nothing can be estimated.

    Raises
    ------
    NotSolvableError
        If an adjustment diverges to numbers that are not finite.
    """
    groups = tuple(part.group for part in variance_groups(solved))
    task = _Estimation(groups, solved, settings, on_iteration, stop_asked, pose)
    estimated, found = np.ones(len(groups), dtype=bool), task.with_equations(solved, np.ones(len(groups)))
    while True:
        found = task.settled(found, estimated)
        known = estimated & found.equations.estimable(_LEAST_REDUNDANCY)
        if (known == estimated).all() or stop_asked():
            return EstimatedErrors(found.solved, found.components(known))
        estimated = known
        found = task.adjusted(found.solved, np.where(known, found.variances, 1.0))


class _Adjusted(NamedTuple):
    """The block as adjusted with errors whose squares have been multiplied by the variances (g,).

    A group of which no observation has full weight has no rows.
    """

    solved: SolvedBlock
    variances: FloatArray
    groups: tuple[GroupRows, ...]
    equations: VarianceEquations

    def components(self, estimated: BoolArray) -> tuple[VarianceComponent, ...]:
        """Return what became of each group."""
        cofactors = self.equations.cofactors(estimated)
        factors = np.where(estimated, np.sqrt(self.variances), np.nan)
        deviations = factors * np.sqrt(cofactors / 2.0)
        return tuple(
            VarianceComponent(
                *part.group,
                number=len(part.rows),
                redundancy=float(self.equations.redundancy[place]),
                factor=float(factors[place]),
                sd=float(deviations[place]),
                p=_probability(float(self.variances[place]), 1.0 / float(cofactors[place])),
            )
            for place, part in enumerate(self.groups)
        )


class _Estimation(Struct, frozen=True):
    groups: tuple[VarianceGroup, ...]
    given: SolvedBlock
    settings: IterationSettings
    on_iteration: Callable[[IterationRecord], None]
    stop_asked: Callable[[], bool]
    pose: Callable[[Block], BlockProblem]

    def settled(self, found: _Adjusted, estimated: BoolArray) -> _Adjusted:
        """Return the block as adjusted with errors that do not change any more."""
        for _ in range(_MOST_ADJUSTMENTS):
            equations = found.equations
            now = estimated & equations.estimable(_LEAST_TO_BEGIN)
            if not now.any() or not found.solved.converged or self.stop_asked():
                break
            variances = np.maximum(found.variances * equations.changes(now), _LEAST_VARIANCE)
            deviations = np.nan_to_num(np.sqrt(2.0 * equations.cofactors(now)))
            settled = np.maximum(_SETTLED, _SETTLED_TO_DEVIATION * deviations)
            if (np.abs(variances / found.variances - 1.0) < settled).all():
                break
            found = self.adjusted(found.solved, variances)
        return found

    def adjusted(self, start: SolvedBlock, variances: FloatArray) -> _Adjusted:
        """Return the block as adjusted with other errors, from the values of another adjustment."""
        block = self.given.block
        factors = dict(zip(self.groups, np.sqrt(variances).tolist(), strict=True))
        problem = replace(self.pose(with_errors_times(block, factors)), excluded=self.given.problem.excluded)
        solved = solve_problem(problem, start.state, self.settings, self.on_iteration, self.stop_asked)
        return self.with_equations(solved, variances)

    def with_equations(self, solved: SolvedBlock, variances: FloatArray) -> _Adjusted:
        """Return an adjusted block with the equations of all groups."""
        now = {part.group: part for part in variance_groups(solved)}
        nothing = np.zeros(0, dtype=np.int64)
        groups = tuple(now.get(group, GroupRows(group, nothing)) for group in self.groups)
        reduced = self.settings.start_down_weight is not None
        limit = self.settings.max_standard_residual if reduced else np.inf
        return _Adjusted(solved, variances, groups, variance_equations(solved, groups, limit))


def _probability(variance: float, freedom: float) -> float:
    """Return the two-sided probability of a variance estimate by chance: freedom times it is nearly chi-square."""
    if not np.isfinite(freedom):
        return np.nan
    half = freedom / 2.0
    return float(2.0 * min(gammainc(half, half * variance), gammaincc(half, half * variance), 0.5))
