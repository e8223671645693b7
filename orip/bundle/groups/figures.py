"""The figures and tests of each group of observations.

The variance factor of the photo points is estimated, and taken as 1 where it is less, so that photo coordinates worse
than their a-priori error do not make other groups look wrong.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Literal, NamedTuple

import numpy as np
from msgspec import Struct
from scipy.special import bdtrc

from orip.adjustment.outlier_tests import (
    against_others,
    chi_square_tail,
    generalised_square_tail,
    largest_of,
    square_sum_tail,
    two_sided_normal,
)
from orip.adjustment.residual_sums import ResidualSums, residual_sums, with_checks_used
from orip.arrays import BoolArray, FloatArray, IntArray, parts
from orip.bundle.groups.held_cameras import HeldCameras, held_cameras
from orip.bundle.groups.observation_groups import (
    MOST_EXACT,
    STATIONS,
    AllStations,
    ObservationGroup,
    Strip,
    largest_exact,
    rows_under_test,
    strip_errors,
    with_correlations,
)
from orip.bundle.solve import SolvedBlock
from orip.records.observation_kinds import PHOTO_POINT
from orip.records.results.tests import GroupTest
from orip.structs import replace

TestName = Literal["mean", "scatter", "point", "down-weighted"]

_MOST_CHECKS = 150
"""Most check coordinates that are tested together and used to tell groups apart; of more an even selection is taken."""

TESTABLE = 1e-4
"""Variance of a sum of residuals, as a part of that of as many independent ones, below which it shows no error."""

_MOST_SINGLE = 20
"""Most distances, and control points, of which each is a hypothesis of its own: scale bars are calibrated, and control
points surveyed, one by one."""

HELD_TESTABLE = 1e-8
"""The same of a held parameter: of C the heights of a block absorb all but a part in many thousands, and photo points
are precise enough to show the rest."""

_SHARE = 0.05
"""Part of the observations that may be down-weighted; more make an adjustment doubtful."""


class JudgedGroup(NamedTuple):
    """A group's figures, the logarithms of the probabilities of its tests, and its median a-priori error."""

    test: GroupTest
    log_p: Mapping[TestName, float]
    typical_error: float


class GroupFigures(Struct, frozen=True):
    """What the tests need of an adjustment; arrays (n,) of all observation equations.

    Parameters
    ----------
    residual : array
        Divided by the a-priori errors.
    error, weight, leverage, redundancy_number : arrays
        Weights of disregarded observations are 0.
    photo_variance : float
        Variance factor of the photo points, 1 at least.
    """

    residual: FloatArray
    error: FloatArray
    weight: FloatArray
    leverage: FloatArray
    redundancy_number: FloatArray
    photo_variance: float

    @classmethod
    def of(cls, solved: SolvedBlock, errors: FloatArray) -> GroupFigures:
        """Return the figures of an adjusted block, whose observations have these a-priori errors (n,)."""
        rows = [kind.rows for kind in solved.problem.observations]
        equations, numbers = solved.equations, solved.variance.redundancy_numbers
        weight = solved.weight_factors
        of_photos = np.concatenate([np.full(len(part.error), part.kind == PHOTO_POINT) for part in rows])
        redundancy = square_sum = 0.0
        for part in parts(len(numbers)):
            full = of_photos[part] & (weight[part] >= 1.0)
            redundancy += float(np.sum(numbers[part][full]))
            square_sum += float(np.sum(equations.residual[part][full] ** 2))
        variance = square_sum / redundancy if redundancy > TESTABLE else 1.0
        return cls(
            equations.residual,
            errors,
            weight,
            solved.cofactors.leverage,
            numbers,
            max(variance, 1.0),
        )


def photo_test(group: ObservationGroup, figures: GroupFigures) -> JudgedGroup:
    """Return figures and tests of photo points.

    Their residuals vary no more than independent ones of the same redundancy, so that both tests are on the safe side.
    """
    redundancy = square_sum = scale = total = squared_factors = 0.0
    for part in parts(len(group.rows)):
        rows = group.rows[part]
        v, weight, error = figures.residual[rows], figures.weight[rows], figures.error[rows]
        full = weight >= 1.0
        redundancy += float(np.sum(figures.redundancy_number[rows][full]))
        square_sum += float(np.sum(v[full] ** 2))
        factors = weight / error
        scale += float(np.sum(factors / error))
        total += float(factors @ v)
        squared_factors += float(factors @ factors)
    bound = math.sqrt(figures.photo_variance * squared_factors)
    log_p: dict[TestName, float] = {}
    if redundancy > TESTABLE:
        log_p["scatter"] = chi_square_tail(square_sum, redundancy)
    if bound > 0.0:
        log_p["mean"] = float(two_sided_normal(total / bound))
    return _tested(
        group, figures, redundancy, _root(square_sum, redundancy), log_p,
        mean=_over(total, scale), mean_sd=_over(bound, scale),
    )  # fmt: skip


class GroundGroups(Struct, frozen=True):
    """The groups on the ground, all but photo points, with k observation equations.

    Parameters
    ----------
    places : tuple of arrays
        Rows of each group's observations among the k.
    sums : ResidualSums
        One for each group: its residuals weighted by their a-priori errors and weight factors.
    errors : array (k, number of groups)
        An error of one unit common to each group, divided by the a-priori errors.
    checks : array (k,) of bool
        The check observations that are tested together.
    strips : tuple of Strip
        Of exposure stations; the drifts of one after the other follow the groups in `sums` and `errors`.
    together : tuple of AllStations
        Their errors follow the drifts.
    singles : tuple of (group, name)
        Distances and control coordinates that are tested one by one; they follow.
    held : HeldCameras or None
        Held parameters of cameras, whose sums are the last ones.
    """

    groups: tuple[ObservationGroup, ...]
    places: tuple[IntArray, ...]
    sums: ResidualSums
    errors: FloatArray
    checks: BoolArray
    strips: tuple[Strip, ...] = ()
    together: tuple[AllStations, ...] = ()
    singles: tuple[tuple[int, str], ...] = ()
    held: HeldCameras | None = None

    @classmethod
    def of(cls, solved: SolvedBlock, groups: Sequence[ObservationGroup], figures: GroupFigures) -> GroundGroups:
        """Return the groups of an adjusted block with the sums of their residuals."""
        ends = np.cumsum([0, *(len(group.rows) for group in groups)])
        places = tuple(np.arange(start, end) for start, end in pairwise(ends.tolist()))
        rows = np.concatenate([np.zeros(0, dtype=np.int64), *(group.rows for group in groups)])
        is_check = np.zeros(len(rows), dtype=bool)
        errors = np.zeros((len(rows), len(groups)))
        for column, (group, mine) in enumerate(zip(groups, places, strict=True)):
            is_check[mine] = group.kind == "check"
            errors[mine, column] = 1.0 / figures.error[group.rows]
        checks = np.zeros(len(rows), dtype=bool)
        checks[_thinned(np.flatnonzero(is_check), _MOST_CHECKS)] = True
        errors[is_check & ~checks] = 0.0
        weight = figures.weight[rows]
        singles, of_singles = _single_observations(groups, places, errors)
        errors, of_singles = (with_correlations(solved, rows, part) for part in (errors, of_singles))
        factors = np.where(is_check, 1.0, weight)[:, None] * errors
        strips: tuple[Strip, ...] = ()
        together: tuple[AllStations, ...] = ()
        if any(group.kind in STATIONS for group in groups):
            found = strip_errors(solved, groups, figures.residual, figures.error, errors, factors)
            strips, errors, factors, together = found.strips, found.errors, found.factors, found.together
        errors, factors = np.hstack([errors, of_singles]), np.hstack([factors, of_singles])
        tested = rows_under_test(solved, rows, weight, figures.photo_variance)
        held = held_cameras(solved, figures.weight)
        sums = residual_sums(tested, factors, None if held is None else held.sums)
        errors = np.hstack([errors, np.zeros((len(rows), sums.factors.shape[1] - errors.shape[1]))])
        return cls(tuple(groups), places, sums, errors, checks, strips, together, singles, held)

    def unit_sums(self, rows: IntArray) -> ResidualSums:
        """Return single residuals as sums."""
        units = np.zeros((len(self.checks), len(rows)))
        units[rows, np.arange(len(rows))] = 1.0
        return residual_sums(self.sums.rows, units)

    def sums_with_checks(self) -> ResidualSums:
        """Return the sums after an adjustment in which the check points take part."""
        if not self.checks.any():
            return self.sums
        return with_checks_used(self.sums, self.checks, self.unit_sums(np.flatnonzero(self.checks)).smoothed)


def _single_observations(
    groups: Sequence[ObservationGroup], places: Sequence[IntArray], errors: FloatArray
) -> tuple[tuple[tuple[int, str], ...], FloatArray]:
    """Return the distances and control coordinates tested one by one, and an error of one unit of each (k, singles)."""
    found = [
        (number, row)
        for number, (group, mine) in enumerate(zip(groups, places, strict=True))
        if group.kind in ("distance", "control") and 1 < len(mine) <= _MOST_SINGLE
        for row in mine.tolist()
    ]
    units = np.zeros((len(errors), len(found)))
    for column, (number, row) in enumerate(found):
        units[row, column] = errors[row, number]
    names = tuple((number, groups[number].names[row - int(places[number][0])]) for number, row in found)
    return names, units


def held_tests(ground: GroundGroups) -> list[GroupTest]:
    """Return the held parameters of cameras as groups without observations."""
    if ground.held is None:
        return []
    sums, count = ground.sums, len(ground.held.groups)
    covariance = sums.covariance()
    variance = np.diag(covariance)
    shift, shift_sd = common_errors(sums, ground.errors, covariance)
    shown = is_testable(sums, variance)
    empty = np.zeros(0)
    nothing = GroupFigures(empty, empty, empty, empty, empty, 1.0)
    found = []
    for group, column in zip(ground.held.groups, range(len(variance) - count, len(variance)), strict=True):
        log_p: dict[TestName, float] = {}
        if shown[column]:
            log_p["mean"] = float(two_sided_normal(sums.values[column] / np.sqrt(variance[column])))
        test = _tested(group, nothing, 0.0, np.nan, log_p, worst=group.names[0]).test
        found.append(replace(test, shift=float(shift[column]), shift_sd=float(shift_sd[column])))
    return found


def ground_tests(ground: GroundGroups, figures: GroupFigures) -> list[JudgedGroup]:
    """Return figures and tests of the groups on the ground."""
    if not ground.groups:
        return []
    sums = ground.sums
    covariance = sums.covariance()
    deviation = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    shown = is_testable(sums, deviation**2)
    shift, shift_sd = common_errors(sums, ground.errors, covariance)
    most_exact = largest_exact([len(group.rows) for group in ground.groups if group.kind != "check"])
    found = []
    for place, group in enumerate(ground.groups):
        total, sd = float(sums.values[place]), float(deviation[place])
        scale = float(sums.factors[:, place] @ ground.errors[:, place])
        of_group = group, ground, ground.places[place], figures
        tested = _check_scatter(*of_group) if group.kind == "check" else scatter_test(*of_group, most_exact)
        log_p = dict(tested.log_p)
        if shown[place]:
            log_p["mean"] = float(two_sided_normal(total / sd))
        test = replace(
            tested.test,
            mean=_over(total, scale),
            mean_sd=_over(sd, scale),
            p_mean=_probability(log_p, "mean"),
            shift=float(shift[place]) if shown[place] else np.nan,
            shift_sd=float(shift_sd[place]) if shown[place] else np.nan,
        )
        found.append(tested._replace(test=test, log_p=log_p))
    return found


def common_errors(sums: ResidualSums, errors: FloatArray, covariance: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the error (j,) common to each group that explains its sum, and its standard deviation (j,).

    `errors` (k, j) are errors of one unit common to each group, `covariance` (j, j) that of the sums. NaN where an
    error leaves the sum as it is.
    """
    response = np.diag(sums.responses(errors))
    scale = np.where(response > 0.0, response, np.nan)
    return -sums.values / scale, np.sqrt(np.maximum(np.diag(covariance), 0.0)) / scale


def is_testable(sums: ResidualSums, variance: FloatArray) -> BoolArray:
    """Return which sums (j,) of residuals with variances (j,) would show an error: not those that unknowns absorb."""
    most = sums.most
    least = TESTABLE if sums.outside is None else np.where(np.diag(sums.outside.square) > 0.0, HELD_TESTABLE, TESTABLE)
    return np.asarray((variance > least * most) & (most > 0.0))


def scatter_test(
    group: ObservationGroup, ground: GroundGroups, mine: IntArray, figures: GroupFigures, most_exact: int = MOST_EXACT
) -> JudgedGroup:
    """Return a group with the test of the square sum of its residuals with full weight.

    `mine` are the rows of its observations among those of `ground`; covariances are used of up to `most_exact`.
    """
    weight = figures.weight[group.rows]
    full = weight >= 1.0
    rows = group.rows[full]
    redundancy = float(np.sum(figures.redundancy_number[rows]))
    square_sum = float(np.sum(figures.residual[rows] ** 2))
    log_p: dict[TestName, float] = {}
    if redundancy > TESTABLE * len(rows) and len(rows) <= most_exact:
        covariance = ground.unit_sums(mine[full]).covariance()
        log_p["scatter"] = square_sum_tail(square_sum, covariance)
    elif redundancy > TESTABLE * len(rows):
        log_p["scatter"] = chi_square_tail(square_sum / figures.photo_variance, redundancy)
    if down := int(np.count_nonzero(~full)):
        log_p["down-weighted"] = float(np.log(bdtrc(down - 1, len(full), _SHARE)))
    only = group.names[0] if len(group.names) == 1 else ""
    return _tested(group, figures, redundancy, _root(square_sum, redundancy), log_p, worst=only)


def _check_scatter(group: ObservationGroup, ground: GroundGroups, mine: IntArray, figures: GroupFigures) -> JudgedGroup:
    """Return check coordinates with the tests of all their differences together, and of the largest of them.

    Each difference is compared with its own standard deviation, and with what the differences of the others predict.
    """
    chosen = np.flatnonzero(ground.checks[mine])
    together = mine[chosen]
    differences, covariance = ground.sums.rows.residual[together], ground.unit_sums(together).covariance()
    quantity, tail = generalised_square_tail(differences, covariance)
    deviation = np.sqrt(1.0 + figures.photo_variance * figures.leverage[group.rows])
    statistic = np.abs(figures.residual[group.rows]) / deviation
    statistic[chosen] = np.maximum(statistic[chosen], against_others(differences, covariance))
    worst = int(np.argmax(statistic))
    row = group.rows[worst]
    log_p: dict[TestName, float] = {
        "scatter": tail,
        "point": largest_of(float(two_sided_normal(statistic[worst])), 2 * len(group.rows)),
    }
    return _tested(
        group, figures, float(len(group.rows)), _root(quantity, float(len(together))), log_p, worst=group.names[worst],
        worst_size=float(figures.residual[row] * figures.error[row]),
    )  # fmt: skip


def _tested(
    group: ObservationGroup, figures: GroupFigures, redundancy: float, sigma0: float,
    log_p: Mapping[TestName, float], *, mean: float = np.nan, mean_sd: float = np.nan, worst: str = "",
    worst_size: float = np.nan,
) -> JudgedGroup:  # fmt: skip
    test = GroupTest(
        kind=group.kind,
        of=group.of,
        component=group.component,
        number=len(group.rows),
        down_weighted=0 if group.kind == "check" else int(np.count_nonzero((figures.weight < 1.0)[group.rows])),
        redundancy=redundancy,
        sigma0=sigma0,
        p_sigma0=_probability(log_p, "scatter"),
        mean=mean,
        mean_sd=mean_sd,
        p_mean=_probability(log_p, "mean"),
        shift=np.nan,
        shift_sd=np.nan,
        worst=worst,
        worst_size=worst_size,
        p_worst=_probability(log_p, "point"),
        doubted=False,
    )
    typical = float(np.median(figures.error[group.rows], overwrite_input=True)) if len(group.rows) else np.nan
    return JudgedGroup(test, log_p, typical)


def _thinned(rows: IntArray, most: int) -> IntArray:
    """Return at most `most` of the rows, evenly spread."""
    return rows[np.unique(np.linspace(0, len(rows) - 1, most).round().astype(np.int64))] if len(rows) > most else rows


def _probability(log_p: Mapping[TestName, float], name: TestName) -> float:
    return float(np.exp(log_p[name])) if name in log_p else np.nan


def _root(square_sum: float, redundancy: float) -> float:
    return float(np.sqrt(square_sum / redundancy)) if redundancy > TESTABLE else np.nan


def _over(value: float, scale: float) -> float:
    return value / scale if scale > 0.0 else np.nan
