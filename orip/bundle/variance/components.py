"""Variance components: the a-priori errors of groups of observations, estimated from their residuals."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import numpy as np
from msgspec import Struct
from scipy.sparse import csr_array
from scipy.special import erf, gammainc, gammaincc

from orip.adjustment.iteration_state import IterationRecord, IterationSettings
from orip.adjustment.residual_sums import residual_sums
from orip.arrays import BoolArray, FloatArray, IntArray
from orip.bundle.groups.observation_groups import rows_under_test
from orip.bundle.kinds.observation import partials_by_unknowns
from orip.bundle.kinds.photo_point import PhotoPointObservations
from orip.bundle.problem import BlockProblem, pose_problem
from orip.bundle.solve import SolvedBlock, solve_problem, without_observations
from orip.bundle.unknowns import CONSTANT
from orip.bundle.variance.groups import (
    GroupRows,
    VarianceGroup,
    variance_groups,
    with_errors_times,
)
from orip.records.block import Block
from orip.records.results.tests import VarianceComponent
from orip.threads import limited_threads

# With the residuals v of observations divided by their a-priori errors, l, the matrix R of v = -R l is a projection.
# The square sum q_i of the residuals of group i has the expectation sum_j H_ij s_j with H_ij = tr(R_ij R_ji), where the
# s_j are the variances of the groups. H s = q gives the estimates; as R is a projection, the rows of H add up to the
# redundancies r_i. Repeated with the new errors until all s are 1, they are those of restricted maximum likelihood,
# whose covariance is 2 H^-1 there.

_MOST_EXACT = 600
"""Observations on the ground of which all pairs are taken."""

_LEAST_SAMPLES, _MOST_SAMPLES = 4, 32
_LARGEST = 20_000_000
"""Random samples of each group, and numbers that the right-hand sides of all may have."""

_SMALL = 1e-12

_MOST_STEP = 2.0
"""Of the logarithm of a variance; far from the solution the equations are no more than a direction."""

_LEAST_SEPARATION = 1e-3
"""Smallest eigenvalue of H scaled to a unit diagonal, below which two groups cannot be told apart."""


class VarianceEquations(Struct, frozen=True):
    """Helmert's equations of g groups.

    Parameters
    ----------
    square_sum : array (g,)
        q.
    redundancy : array (g,)
    matrix : array (g, g)
        H.
    """

    square_sum: FloatArray
    redundancy: FloatArray
    matrix: FloatArray

    def estimable(self, least_redundancy: float) -> BoolArray:
        """Return the groups (g,) with so much redundancy that can be told from each other.

        Of those that cannot be told apart the one with the least redundancy is left out.
        """
        found = self.redundancy >= least_redundancy
        while found.sum() > 1:
            rows = np.flatnonzero(found)
            scale = 1.0 / np.sqrt(np.diag(self.matrix)[rows])
            values, vectors = np.linalg.eigh(self.matrix[np.ix_(rows, rows)] * np.outer(scale, scale))
            if values[0] > _LEAST_SEPARATION:
                break
            alike = rows[np.abs(vectors[:, 0]) > 0.5 * np.abs(vectors[:, 0]).max()]
            found[alike[np.argmin(self.redundancy[alike])]] = False
        return found

    def changes(self, estimated: BoolArray) -> FloatArray:
        """Return the factors (g,) to multiply the variances by; 1 for groups that are not estimated.

        They are exp(H^-1 (q - r)), Fisher's scoring for the logarithms of the variances: to first order Helmert's
        estimates, and never negative.
        """
        rows = np.flatnonzero(estimated)
        result = np.ones(len(estimated))
        excess = self.square_sum[rows] - self.redundancy[rows]
        steps = np.linalg.solve(self.matrix[np.ix_(rows, rows)], excess)
        result[rows] = np.exp(np.clip(steps, -_MOST_STEP, _MOST_STEP))
        return result

    def cofactors(self, estimated: BoolArray) -> FloatArray:
        """Return the diagonal (g,) of H^-1 for variances of 1; NaN for groups that are not estimated."""
        rows = np.flatnonzero(estimated)
        result = np.full(len(estimated), np.nan)
        result[rows] = np.diag(np.linalg.inv(self.matrix[np.ix_(rows, rows)]))
        return result


def variance_equations(solved: SolvedBlock, groups: Sequence[GroupRows], limit: float = np.inf) -> VarianceEquations:
    """Return Helmert's equations of an adjusted block.

    H is exact for one camera and up to 600 observations on the ground. What the photo points of several cameras share
    with each other and with what is on the ground, and groups of more observations, is estimated (`_estimated_pairs`),
    mostly to a hundredth of it.

    Parameters
    ----------
    groups : sequence of GroupRows
        With the observations of full weight alone.
    limit : float
        Standard residual above which observations have lost weight.
    """
    numbers, residual = solved.variance.redundancy_numbers, solved.equations.residual
    redundancy = np.array([float(np.sum(numbers[group.rows])) for group in groups])
    square_sum = np.array([float(np.sum(residual[group.rows] ** 2)) for group in groups])
    square_sum *= _lost_tails(solved, groups, redundancy, limit)
    of_photos = np.array([group.group.kind == "photo" for group in groups], dtype=bool)
    photos, ground = np.flatnonzero(of_photos), np.flatnonzero(~of_photos)
    few = sum(len(groups[place].rows) for place in ground.tolist()) <= _MOST_EXACT
    several = len(photos) > 1
    probed = np.concatenate([photos if several else photos[:0], ground[:0] if few else ground])
    matrix = _estimated_pairs(solved, groups, probed)
    if few:
        matrix[np.ix_(ground, ground)] = _pairs(solved, [groups[place].rows for place in ground.tolist()])
        common = np.maximum(redundancy[ground] - matrix[np.ix_(ground, ground)].sum(axis=1), 0.0)
        crossing = matrix[np.ix_(photos, ground)] if several else np.ones((len(photos), len(ground)))
        crossing *= common / np.maximum(crossing.sum(axis=0), _SMALL)
        matrix[np.ix_(photos, ground)], matrix[np.ix_(ground, photos)] = crossing, crossing.T
    for place in photos if few else range(len(groups)):
        matrix[place, place] = 0.0
        matrix[place, place] = redundancy[place] - matrix[place].sum()
    return VarianceEquations(square_sum, redundancy, matrix)


def _estimated_pairs(solved: SolvedBlock, groups: Sequence[GroupRows], probed: IntArray) -> FloatArray:
    """Return the elements of H (g, g) in the rows and columns of some groups, except for the diagonal; others are 0.

    Between two groups R is -A_i Q A_j^T, and H_ij the sum of its squares. With random signs s for the observations of
    group j that is the expectation of the square sum of A_i Q A_j^T s (Hutchinson 1990, *A stochastic estimator of the
    trace of the influence matrix*; for variance components Koch and Kusche 2002). Its relative error is the root of 2
    over the number of samples and the many unknowns that both groups share. The signs are the same in each run.
    """
    result = np.zeros((len(groups), len(groups)))
    if not len(probed):
        return result
    size = solved.problem.layout.size
    samples = int(np.clip(_LARGEST // (size * len(probed)), _LEAST_SAMPLES, _MOST_SAMPLES))
    random, right = np.random.default_rng(0), np.zeros((size, samples * len(probed)))
    number = np.full(len(solved.equations.residual), -1)
    for place, group in enumerate(groups):
        number[group.rows] = place
    for part, design in _design_in_parts(solved):
        for at, place in enumerate(probed.tolist()):
            rows = np.flatnonzero(number[part] == place)
            right[:, at * samples : (at + 1) * samples] += design[rows].T @ random.choice(
                [-1.0, 1.0], (len(rows), samples)
            )
    with limited_threads(None):
        moved = solved.normals.solve(right)
    for part, design in _design_in_parts(solved):
        squares = (design @ moved) ** 2
        for place in range(len(groups)):
            mine = squares[number[part] == place].sum(axis=0)
            result[place, probed] += mine.reshape(len(probed), samples).mean(axis=1)
    both = np.ix_(probed, probed)
    result[both] = (result[both] + result[both].T) / 2.0
    result[probed] = result[:, probed].T
    return result


def _design_in_parts(solved: SolvedBlock) -> Iterator[tuple[IntArray, csr_array]]:
    """Yield rows of the design matrix, divided by the a-priori errors, some thousands at a time, with their numbers."""
    first, ground = 0, [np.zeros(0, dtype=np.int64)]
    for kind in solved.problem.observations:
        numbers = first + np.arange(len(kind.rows.error))
        first += len(numbers)
        if not isinstance(kind, PhotoPointObservations):
            ground.append(numbers)
            continue
        start = 0
        for part in kind.in_parts():
            _, (partials, columns) = partials_by_unknowns(part, solved.state, solved.problem.unknowns)
            rows, places = np.nonzero(columns != CONSTANT)
            values = (partials / part.rows.error[:, None])[rows, places]
            shape = (len(columns), solved.problem.layout.size)
            yield numbers[start : start + len(columns)], csr_array((values, (rows, columns[rows, places])), shape=shape)
            start += len(columns)
    rest = np.concatenate(ground)
    yield rest, solved.ground_design(rest)


def _lost_tails(solved: SolvedBlock, groups: Sequence[GroupRows], redundancy: FloatArray, limit: float) -> FloatArray:
    """Return by what (g,) square sums are too small because larger residuals have lost weight, and do not count.

    A normal residual with redundancy number r has the variance r (1 - 2 c f(c) / (2 F(c) - 1)) as long as it is below
    the limit c sqrt(r) of the Danish method, with the density f and the distribution F of the normal distribution.
    """
    result = np.ones(len(groups))
    if not np.isfinite(limit):
        return result
    for place, group in enumerate(groups):
        numbers = np.maximum(solved.variance.redundancy_numbers[group.rows], 0.0)
        c = limit / np.sqrt(np.maximum(numbers, _SMALL))
        inside = np.sum(numbers * (1.0 - np.sqrt(2.0 / np.pi) * c * np.exp(-(c**2) / 2.0) / erf(c / np.sqrt(2.0))))
        if inside > 0.0:
            result[place] = redundancy[place] / inside
    return result


def _pairs(solved: SolvedBlock, rows: Sequence[IntArray]) -> FloatArray:
    """Return H (g, g) of groups of few observations on the ground."""
    every = np.concatenate([np.zeros(0, dtype=np.int64), *rows])
    if not len(every):
        return np.zeros((len(rows), len(rows)))
    tested = rows_under_test(solved, every, np.ones(len(every)))
    squares = (np.eye(len(every)) - residual_sums(tested, np.eye(len(every))).smoothed) ** 2
    member = np.zeros((len(every), len(rows)))
    member[np.arange(len(every)), np.repeat(np.arange(len(rows)), [len(part) for part in rows])] = 1.0
    return np.asarray(member.T @ squares @ member)


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
        problem, excluded = self.pose(with_errors_times(block, factors)), self.given.problem.excluded
        problem = problem if excluded is None else without_observations(problem, excluded)
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
