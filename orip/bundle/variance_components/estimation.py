"""A-priori errors estimated group by group: a block is adjusted again with them until they no longer change."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.special import gammainc, gammaincc

from orip.adjustment.iteration import IterationRecord, IterationSettings
from orip.arrays import BoolArray, FloatArray
from orip.bundle.problem import pose_problem
from orip.bundle.solve import SolvedBlock, solve_problem
from orip.bundle.variance_components.helmert import VarianceEquations, variance_equations
from orip.bundle.variance_components.variance_groups import (
    GroupRows,
    VarianceGroup,
    variance_groups,
    with_errors_times,
)
from orip.records.results.variance_component import VarianceComponent

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
    task = _Estimation(groups, solved, settings, on_iteration, stop_asked)
    estimated, found = np.ones(len(groups), dtype=bool), _Adjusted(solved, np.ones(len(groups)))
    while True:
        found = task.settled(found, estimated)
        known = estimated & task.equations(found.solved).estimable(_LEAST_REDUNDANCY)
        if (known == estimated).all() or stop_asked():
            return EstimatedErrors(found.solved, task.components(found, known))
        estimated = known
        found = task.adjusted(found.solved, np.where(known, found.variances, 1.0))


class _Adjusted(NamedTuple):
    """The block as adjusted with errors whose squares have been multiplied by the variances (g,)."""

    solved: SolvedBlock
    variances: FloatArray


@dataclass(frozen=True, slots=True)
class _Estimation:
    groups: tuple[VarianceGroup, ...]
    given: SolvedBlock
    settings: IterationSettings
    on_iteration: Callable[[IterationRecord], None]
    stop_asked: Callable[[], bool]

    def settled(self, found: _Adjusted, estimated: BoolArray) -> _Adjusted:
        """Return the block as adjusted with errors that do not change any more."""
        for _ in range(_MOST_ADJUSTMENTS):
            equations = self.equations(found.solved)
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
        problem = replace(pose_problem(with_errors_times(block, factors)), excluded=self.given.problem.excluded)
        return _Adjusted(
            solve_problem(problem, start.state, self.settings, self.on_iteration, self.stop_asked), variances
        )

    def equations(self, solved: SolvedBlock) -> VarianceEquations:
        """Return the equations of all groups; a group of which no observation has full weight is empty."""
        reduced = self.settings.start_down_weight is not None
        limit = self.settings.max_standard_residual if reduced else np.inf
        return variance_equations(solved, self.rows(solved), limit)

    def rows(self, solved: SolvedBlock) -> tuple[GroupRows, ...]:
        """Return all groups with their observations of full weight."""
        now = {part.group: part for part in variance_groups(solved)}
        nothing = np.zeros(0, dtype=np.int64)
        return tuple(now.get(group, GroupRows(group, nothing)) for group in self.groups)

    def components(self, found: _Adjusted, estimated: BoolArray) -> tuple[VarianceComponent, ...]:
        """Return what became of each group."""
        equations = self.equations(found.solved)
        cofactors = equations.cofactors(estimated)
        factors = np.where(estimated, np.sqrt(found.variances), np.nan)
        deviations = factors * np.sqrt(cofactors / 2.0)
        return tuple(
            VarianceComponent(
                *part.group,
                number=len(part.rows),
                redundancy=float(equations.redundancy[place]),
                factor=float(factors[place]),
                sd=float(deviations[place]),
                p=_probability(float(found.variances[place]), 1.0 / float(cofactors[place])),
            )
            for place, part in enumerate(self.rows(found.solved))
        )


def _probability(variance: float, freedom: float) -> float:
    """Return the two-sided probability of a variance estimate by chance: freedom times it is nearly chi-square."""
    if not np.isfinite(freedom):
        return np.nan
    half = freedom / 2.0
    return float(2.0 * min(gammainc(half, half * variance), gammaincc(half, half * variance), 0.5))
