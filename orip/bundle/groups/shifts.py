"""Errors common to groups of observations, to stations, or due to a held camera: the gravest first.

Those of several components are tested in all of them together (Baarda 1968, the test of several alternative errors),
and in each alone; those of a strip once as a shift and once as a shift with a drift. Tests of different freedom compete
by their probabilities.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.special import ndtri_exp

from orip.adjustment.outlier_tests import chi_square_tail, two_sided_normal
from orip.adjustment.residual_sums import ResidualSums
from orip.arrays import BoolArray, FloatArray
from orip.bundle.groups.figures import TESTABLE, GroundGroups, is_testable
from orip.bundle.groups.hypotheses import SINGLE_CONTROL, Cause, Together, hypotheses
from orip.records.results.tests import CommonError
from orip.structs import replace

_ALIKE = 6.0
"""Two shifts cannot be told apart if their squared statistics differ by less: a likelihood ratio of 20."""

_SAME_MISFIT = 0.5
"""Part of its squared statistic that another error leaves of one that explains the same misfit, at the most."""

_MOST_ALTERNATIVES = 3

_FURTHER = np.log(0.01)
"""Logarithm of the probability below which the other components of a shift are off as well."""

_MATERIAL = 0.01
"""Mean square that a held parameter's error leaves in the photo coordinates, in a-priori variances, from which it
counts by itself: photo points are so many that immaterial errors are significant."""

_EXPLAINS = 0.25
"""Part of what photo coordinates misfit by, beyond their a-priori errors, that a held parameter explains at least."""

_SCATTERED, _FEWEST_OTHERS = 2.0, 6
"""Median square of the standardised residuals of other control points, of so many coordinates at least, from which none
of them is off alone: their a-priori errors are too small. By chance it is 0.45."""

_EQUAL = 1e-6
"""Part of a statistic by which equal ones differ at most from rounding."""


class CommonShift(NamedTuple):
    """An error common to groups.

    Parameters
    ----------
    log_p : float
        Logarithm of the probability that chance alone gives as much or more.
    alternatives : tuple of Cause
        What it cannot be told apart from.
    doubted : tuple of int
        All groups that it and these concern.
    shift, shift_sd : float
        Of the first component.
    common : tuple of CommonError
        Of stations and of several components: each of them.
    """

    log_p: float
    cause: Cause
    alternatives: tuple[Cause, ...]
    doubted: tuple[int, ...]
    shift: float
    shift_sd: float
    common: tuple[CommonError, ...] = ()


class _Sums(NamedTuple):
    """Values and covariance of all sums once errors have been allowed for, and which of them show an error.

    `response` is how they change with each error. It is proportional to the covariance only where all a-priori errors
    are right, and an error has to be gone completely however large it is.
    """

    values: FloatArray
    covariance: FloatArray
    response: FloatArray
    testable: BoolArray

    def without(self, test: Together, sums: ResidualSums) -> _Sums:
        """Return them once the error of a test has been allowed for, as if it were another unknown."""
        columns = [column for column in test.columns if self.testable[column]]
        own = self.response[np.ix_(columns, columns)]
        scale = np.sqrt(np.abs(np.diag(own)))
        gain = self.response[:, columns] / scale @ np.linalg.pinv(own / np.outer(scale, scale)) / scale
        values = self.values - gain @ self.values[columns]
        half = self.covariance - gain @ self.covariance[columns]
        covariance = half - half[:, columns] @ gain.T
        response = self.response - gain @ self.response[columns]
        return _Sums(values, covariance, response, self.testable & is_testable(sums, np.diag(covariance)))

    def _scaled_inverse(self, columns: list[int]) -> tuple[FloatArray, FloatArray]:
        """Return the inverse of the correlations of some sums, and their standard deviations."""
        scale = np.sqrt(np.diag(self.covariance)[columns])
        return np.linalg.pinv(self.covariance[np.ix_(columns, columns)] / np.outer(scale, scale)), scale

    def error(self, column: int) -> tuple[float, float]:
        """Return the error that explains a sum, and its standard deviation; NaN where it leaves the sum as it is."""
        response = self.response[column, column]
        if response <= 0.0:
            return np.nan, np.nan
        deviation = np.sqrt(max(self.covariance[column, column], 0.0))
        return float(-self.values[column] / response), float(deviation / response)

    def square(self, test: Together) -> float:
        """Return the square of the normal variable that is as improbable as the sums of a test."""
        columns = [column for column in test.columns if self.testable[column]]
        if not columns:
            return 0.0
        if len(columns) == 1:
            (column,) = columns
            return float(self.values[column] ** 2 / self.covariance[column, column])
        inverse, scale = self._scaled_inverse(columns)
        scaled = self.values[columns] / scale
        log_p = chi_square_tail(float(scaled @ inverse @ scaled), float(len(columns)))
        return _square_of(log_p) if log_p < 0.0 else 0.0

    def together(self, columns: list[int]) -> tuple[float, int]:
        """Return v^T C^+ v of some sums that show an error, and its freedom."""
        columns = [column for column in columns if self.testable[column]]
        scale = np.sqrt(np.diag(self.covariance)[columns])
        values, axes = np.linalg.eigh(self.covariance[np.ix_(columns, columns)] / np.outer(scale, scale))
        free = values > TESTABLE * len(columns)
        along = (self.values[columns] / scale) @ axes[:, free]
        return float(np.sum(along**2 / values[free])), int(np.count_nonzero(free))


class CommonShifts(NamedTuple):
    """The errors common to groups, and whether control is less precise than is said: no point of it is then accused."""

    found: tuple[CommonShift, ...]
    is_control_less_precise: bool


def common_shifts(
    ground: GroundGroups, sums: ResidualSums, limit: float, *, is_control_less_precise: bool = False
) -> CommonShifts:
    """Return the errors common to groups, the gravest first, each after those before it have been allowed for.

    An error found takes the part of all other sums that is correlated with it, as if it were another unknown.

    Parameters
    ----------
    sums : ResidualSums
        Those of the groups, after the check points have been used.
    limit : float
        Logarithm of the probability below which a group is doubted.
    is_control_less_precise : bool
        Known already.
    """
    covariance = sums.covariance()
    left = _Sums(sums.values, covariance, sums.responses(ground.errors), is_testable(sums, np.diag(covariance)))
    tests = [test for test in hypotheses(ground) if _is_determined(ground, left, test)]
    if is_control_less_precise:
        tests = [test for test in tests if not test.is_single_control]
    gone, shifts = set[tuple[str, ...]](), list[CommonShift]()
    while True:
        possible = [test for test in tests if test.span not in gone and left.testable[list(test.columns)].any()]
        squares = np.array([left.square(test) for test in possible])
        squares = _without_single_control(possible, _without_immaterial(possible, squares, ground, limit), limit)
        if not squares.any():
            break
        # the first of those that are equal up to rounding, so that the words are the same on all processors
        best = int(np.argmax(squares >= (1.0 - _EQUAL) * squares.max()))
        best = _rather_shift(possible, squares, best)
        log_p = _log_p(float(squares[best]))
        if log_p >= limit:
            break
        rest = left.without(possible[best], sums)
        if possible[best].is_single_control and _are_less_precise(tests, possible[best], left, rest):
            tests = [test for test in tests if not test.is_single_control]
            is_control_less_precise = True
            continue
        others = _alternatives(possible, squares, best, rest, limit)
        chosen, others = _rather_stations(possible[best], others)
        chosen = _with_further_components(possible, chosen, left, sums)
        chosen = _without_drift(possible, chosen, left, limit)
        common = _common(ground, left, chosen)
        if chosen.extent == "one" and all(abs(error.size) < error.sd for error in common):
            chosen, common = possible[best], ()  # its coordinates cannot be told apart
        shift, shift_sd = left.error(chosen.columns[0])
        doubted = tuple(dict.fromkeys(group for test in (chosen, *others) for group in test.groups))
        alternatives = tuple(test.cause for test in others)
        shifts.append(CommonShift(log_p, chosen.cause, alternatives, doubted, shift, shift_sd, common))
        gone |= {test.span for test in (chosen, *others)}
        left = left.without(chosen, sums)
    return CommonShifts(tuple(shifts), is_control_less_precise)


def _log_p(square: float) -> float:
    return float(two_sided_normal(np.sqrt(square)))


def _without_single_control(tests: Sequence[Together], squares: FloatArray, limit: float) -> FloatArray:
    """Return the squares without those of single control points, where nothing else is wrong and they hardly are."""
    single = np.array([test.is_single_control for test in tests], dtype=bool)
    if not single.any() or _log_p(float(squares[~single].max(initial=0.0))) < limit:
        return squares
    return np.where(single & (squares < _square_of(limit + np.log(SINGLE_CONTROL))), 0.0, squares)


def _are_less_precise(tests: Sequence[Together], best: Together, left: _Sums, rest: _Sums) -> bool:
    """Tell whether a-priori errors that are too small explain more than that one control point is off.

    Other points misfit, too, once it has been allowed for; or the likelihood with errors of a common factor is not
    smaller, by a ratio of 20, than with that point off: each with half the logarithm of the redundancy for a parameter
    (Schwarz 1978, *Estimating the dimension of a model*), and as one point of several is chosen.
    """
    coordinates = [test for test in tests if test.is_single_control and len(test.columns) == 1]
    others = [test for test in coordinates if test.span != best.span and rest.testable[test.columns[0]]]
    squares = [rest.square(test) for test in others]
    if len(squares) >= _FEWEST_OTHERS and float(np.median(squares)) > _SCATTERED:
        return True
    columns = [test.columns[0] for test in coordinates]
    square, freedom = left.together(columns)
    square_of_others, freedom_of_others = rest.together(columns)
    if freedom_of_others < _FEWEST_OTHERS:
        return False
    parameter = np.log(freedom) / 2.0
    of_all = freedom / 2.0 * (1.0 + np.log(square / freedom)) + parameter
    of_one = square_of_others / 2.0 + (freedom - freedom_of_others) * parameter
    of_one += np.log(len({test.span for test in coordinates}))
    return bool(of_all <= of_one + _ALIKE / 2.0)


def _square_of(log_p: float) -> float:
    return float(ndtri_exp(log_p - np.log(2.0)) ** 2)


def _without_immaterial(
    tests: Sequence[Together], squares: FloatArray, ground: GroundGroups, limit: float
) -> FloatArray:
    """Return the squares without those of held parameters that explain little.

    That is little of residuals that blunders have made large, or of those as large as they should be, where nothing
    else is wrong.
    """
    is_held = np.array([test.extent == "held" for test in tests], dtype=bool)
    if ground.held is None or not is_held.any():
        return squares
    number = np.array(
        [
            ground.held.number[test.groups[0] - len(ground.groups)] if held else 0
            for test, held in zip(tests, is_held.tolist(), strict=True)
        ]
    )
    variance = ground.sums.rows.others_variance
    little = variance * squares < _EXPLAINS * (variance - 1.0) * number
    if _log_p(float(squares[~is_held].max(initial=0.0))) >= limit:
        little |= squares < _MATERIAL * number
    return np.where(is_held & little, 0.0, squares)


def _alternatives(
    tests: Sequence[Together], squares: FloatArray, best: int, left: _Sums, limit: float
) -> list[Together]:
    """Return what explains the misfit about as well: once the best is allowed for, nothing is left of it."""
    found: dict[tuple[str, ...], tuple[float, Together]] = {}
    for test, square in zip(tests, squares.tolist(), strict=True):
        if test.span == tests[best].span or square <= squares[best] - _ALIKE:
            continue
        rest = left.square(test)
        if rest > _SAME_MISFIT * square or _log_p(rest) < limit:
            continue
        if test.span not in found or square > found[test.span][0]:
            found[test.span] = square, test
    ordered = sorted(found.values(), key=lambda pair: -pair[0])
    return [test for _, test in ordered[:_MOST_ALTERNATIVES]]


def _rather_shift(tests: Sequence[Together], squares: FloatArray, best: int) -> int:
    """Return the shift of all stations, or of their only strip, in place of a lever arm that is hardly likelier."""
    if tests[best].extent != "lever arm":
        return best
    alike = [
        number
        for number, test in enumerate(tests)
        if test.extent != "lever arm" and test.span == tests[best].span and squares[number] > squares[best] - _ALIKE
    ]
    return max(alike, key=lambda number: float(squares[number]), default=best)


def _rather_stations(best: Together, others: list[Together]) -> tuple[Together, list[Together]]:
    """Return the stations before all of the control, which contradict each other alike: control was surveyed."""
    of_stations = [
        test for test in others if test.extent in ("all", "whole") and test.span[0] in ("station", "element")
    ]
    if best.extent != "whole" or best.span != ("control",) or not of_stations:
        return best, others
    return of_stations[0], [best, *(test for test in others if test is not of_stations[0])]


def _with_further_components(tests: Sequence[Together], best: Together, left: _Sums, sums: ResidualSums) -> Together:
    """Return the shift in all components in place of that in one, where the others are off as well."""
    if len(best.columns) > 1:
        return best
    rest = left.without(best, sums)
    for test in tests:
        if test.span == best.span and best.columns[0] in test.columns and len(test.columns) > 1 and not test.has_drift:
            others = replace(test, columns=tuple(set(test.columns) - set(best.columns)))
            if _log_p(rest.square(others)) < _FURTHER:
                return test
    return best


class _Estimate(NamedTuple):
    """Columns of a test that show an error, the errors, and their covariance."""

    columns: list[int]
    size: FloatArray
    covariance: FloatArray


def _estimated(sums: _Sums, test: Together) -> _Estimate:
    columns = [column for column in test.columns if sums.testable[column]]
    inverse = np.linalg.pinv(sums.response[np.ix_(columns, columns)])
    covariance = inverse @ sums.covariance[np.ix_(columns, columns)] @ inverse.T
    return _Estimate(columns, np.asarray(-inverse @ sums.values[columns]), np.asarray(covariance))


def _is_determined(ground: GroundGroups, sums: _Sums, test: Together) -> bool:
    """Tell whether an error would be found to a hundred times the a-priori error of the mean: unknowns absorb others.

    Where observations have lost weight the sums of what is absorbed vary nevertheless, and its size would be anything.
    """
    if test.extent == "held":
        return True
    found = _estimated(sums, test)
    of_mean = 1.0 / np.sum(ground.errors[:, found.columns] ** 2, axis=0)
    return bool((np.diag(found.covariance) * TESTABLE < of_mean).all())


def _without_drift(tests: Sequence[Together], best: Together, sums: _Sums, limit: float) -> Together:
    """Return the test of a strip's shift alone in place of one with a drift that is not significant itself.

    Where weights are reduced the statistic of both together overrates the drift.
    """
    found = _estimated(sums, best)
    names = dict(zip(best.columns, best.components, strict=True))
    drifts = [place for place, column in enumerate(found.columns) if names[column][1]]
    if not drifts:
        return best
    of_drifts = np.linalg.pinv(found.covariance[np.ix_(drifts, drifts)])
    quantity = float(found.size[drifts] @ of_drifts @ found.size[drifts])
    if chi_square_tail(quantity, float(len(drifts))) < limit:
        return best
    return next(test for test in tests if test.columns == best.groups)


def _common(ground: GroundGroups, sums: _Sums, test: Together) -> tuple[CommonError, ...]:
    """Return the errors of stations and of several components; none of others, or where none can be tested."""
    of_stations = any(test.groups[0] in strip.groups for strip in ground.strips)
    is_point = test.extent == "one" and len(test.columns) > 1
    if not (of_stations or is_point or test.extent == "whole") or not sums.testable[list(test.columns)].any():
        return ()
    found = _estimated(sums, test)
    names = dict(zip(test.columns, test.components, strict=True))
    return tuple(
        CommonError(*names[column], float(one), float(deviation))
        for column, one, deviation in zip(
            found.columns, found.size, np.sqrt(np.maximum(np.diag(found.covariance), 0.0)), strict=True
        )
        if deviation > 0.0
    )
