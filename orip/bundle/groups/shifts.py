"""Errors common to a group of observations, or to the stations of a strip: the gravest first.

Those of a strip are tested in all components together (Baarda 1968, the test of several alternative errors), once as a
shift and once as a shift with a drift. Tests of different freedom compete by their probabilities.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from msgspec import Struct
from scipy.special import ndtri_exp

from orip.adjustment.group_tests import chi_square_tail, two_sided_normal
from orip.adjustment.residual_sums import ResidualSums
from orip.arrays import BoolArray, FloatArray
from orip.bundle.groups.figures import GroundGroups, common_errors, is_testable
from orip.records.results.group_test import CommonError, CommonExtent

_ALIKE = 6.0
"""Two shifts cannot be told apart if their squared statistics differ by less: a likelihood ratio of 20."""

_EQUAL = 1e-6
"""Part of a statistic by which equal ones differ at most from rounding."""


class CommonShift(NamedTuple):
    """An error common to groups.

    Parameters
    ----------
    log_p : float
        Logarithm of the probability of so much or more by chance.
    groups : tuple of int
        The group that it is named by, then those that it cannot be told apart from.
    doubted : tuple of int
        All groups that it concerns.
    shift, shift_sd : float
        Of the first one.
    common : tuple of CommonError
        Of stations: all components.
    extent : CommonExtent
        Whose stations these are.
    """

    log_p: float
    groups: tuple[int, ...]
    doubted: tuple[int, ...]
    shift: float
    shift_sd: float
    common: tuple[CommonError, ...] = ()
    extent: CommonExtent = "strip"


class _Together(Struct, frozen=True):
    """Sums that are tested together.

    Parameters
    ----------
    columns : tuple of int
    components : tuple of (str, bool)
        Of each column: what it is called, and whether it is a drift; shifts come first.
    groups : tuple of int
        Those that it concerns.
    extent : CommonExtent
    """

    columns: tuple[int, ...]
    components: tuple[tuple[str, bool], ...]
    groups: tuple[int, ...]
    extent: CommonExtent = "strip"

    @property
    def group(self) -> int:
        """Return the group that it is named by."""
        return self.groups[0]


def common_shifts(ground: GroundGroups, sums: ResidualSums, limit: float) -> Iterator[CommonShift]:
    """Yield the errors common to groups, the gravest first, each after those before it have been allowed for.

    An error found takes the part of all other sums that is correlated with it, as if it were another unknown.

    Parameters
    ----------
    ground : GroundGroups
    sums : ResidualSums
        Those of the groups, after the check points have been used.
    limit : float
        Logarithm of the probability below which a group is doubted.
    """
    values, covariance = sums.values.copy(), sums.covariance()
    shift, shift_sd = common_errors(sums, ground.errors, covariance)
    most = np.sum(sums.factors**2, axis=0)
    tests = _tested_together(ground)
    testable = is_testable(most, np.diag(covariance))
    possible = np.array([testable[list(test.columns)].any() for test in tests], dtype=bool)
    while possible.any():
        squares = np.array(
            [
                _square(test, values, covariance, testable) if fit else 0.0
                for test, fit in zip(tests, possible, strict=True)
            ]
        )
        # the first of those that are equal up to rounding, so that the words are the same on all processors
        best = int(np.argmax(squares >= (1.0 - _EQUAL) * squares.max()))
        best = _rather_shift(tests, squares, best)
        log_p = float(two_sided_normal(np.sqrt(squares[best])))
        if log_p >= limit:
            return
        alike = possible & (squares > squares[best] - _ALIKE)
        others = [
            tests[number]
            for number in np.flatnonzero(alike).tolist()
            if tests[number].extent == "strip" and tests[number].group not in tests[best].groups
        ]
        named = tuple(dict.fromkeys(test.group for test in (tests[best], *others)))
        doubted = tuple(dict.fromkeys(group for test in (tests[best], *others) for group in test.groups))
        chosen = _without_drift(tests, tests[best], ground, sums, testable, limit)
        first, common = chosen.group, _common(ground, sums, chosen, testable)
        yield CommonShift(log_p, named, doubted, float(shift[first]), float(shift_sd[first]), common, chosen.extent)
        values, covariance = _without(chosen, values, covariance, testable)
        testable &= is_testable(most, np.diag(covariance))
        gone = {test.group for test in (tests[best], *others) if test.extent == "strip"}
        gone_with = {tests[best].groups} if tests[best].extent != "strip" else set()
        possible &= np.array(
            [
                not (test.extent == "strip" and test.group in gone)
                and test.groups not in gone_with
                and bool(testable[list(test.columns)].any())
                for test in tests
            ],
            dtype=bool,
        )


def _tested_together(ground: GroundGroups) -> list[_Together]:
    """Return each group by itself, and strips as a shift and, where times are known, as a shift with a drift."""
    of_strips = {number for strip in ground.strips for number in strip.groups}
    tests = [
        _Together((number,), ((group.component, False),), (number,))
        for number, group in enumerate(ground.groups)
        if number not in of_strips
    ]
    first = len(ground.groups)
    for strip in ground.strips:
        names = [ground.groups[number].component for number in strip.groups]
        shifts = tuple((name, False) for name in names)
        tests.append(_Together(strip.groups, shifts, strip.groups))
        if strip.has_drift:
            columns = (*strip.groups, *range(first, first + len(names)))
            tests.append(_Together(columns, (*shifts, *((name, True) for name in names)), strip.groups))
            first += len(names)
    for all_stations in ground.together:
        count = len(all_stations.components)
        components = tuple((name, False) for name in all_stations.components)
        columns = tuple(range(first, first + count))
        tests.append(_Together(columns, components, all_stations.groups, all_stations.extent))
        first += count
    return tests


def _rather_shift(tests: Sequence[_Together], squares: FloatArray, best: int) -> int:
    """Return the shift of all stations, or of their only strip, in place of a lever arm that is hardly likelier."""
    if tests[best].extent != "lever arm":
        return best
    alike = [
        number
        for number, test in enumerate(tests)
        if test.extent != "lever arm" and test.groups == tests[best].groups and squares[number] > squares[best] - _ALIKE
    ]
    return max(alike, key=lambda number: float(squares[number]), default=best)


def _square(test: _Together, values: FloatArray, covariance: FloatArray, testable: BoolArray) -> float:
    """Return the square of the normal variable that is as improbable as the sums of a test."""
    columns = [column for column in test.columns if testable[column]]
    if len(columns) == 1:
        (column,) = columns
        return float(values[column] ** 2 / covariance[column, column])
    of_test = covariance[np.ix_(columns, columns)]
    log_p = chi_square_tail(float(values[columns] @ np.linalg.pinv(of_test) @ values[columns]), float(len(columns)))
    return float(ndtri_exp(log_p - np.log(2.0)) ** 2) if log_p < 0.0 else 0.0


def _without(
    test: _Together, values: FloatArray, covariance: FloatArray, testable: BoolArray
) -> tuple[FloatArray, FloatArray]:
    """Return values and covariance of all sums once the error of a test has been allowed for."""
    columns = [column for column in test.columns if testable[column]]
    gain = covariance[:, columns] @ np.linalg.pinv(covariance[np.ix_(columns, columns)])
    return values - gain @ values[columns], covariance - gain @ covariance[columns]


class _Estimate(NamedTuple):
    """Columns of a test that show an error, the errors, and their covariance."""

    columns: list[int]
    size: FloatArray
    covariance: FloatArray


def _estimated(ground: GroundGroups, sums: ResidualSums, test: _Together, testable: BoolArray) -> _Estimate:
    columns = [column for column in test.columns if testable[column]]
    response = np.array([sums.response(ground.errors[:, column])[columns] for column in columns]).T
    inverse = np.linalg.pinv(response)
    covariance = inverse @ sums.covariance()[np.ix_(columns, columns)] @ inverse.T
    return _Estimate(columns, np.asarray(-inverse @ sums.values[columns]), np.asarray(covariance))


def _without_drift(
    tests: Sequence[_Together], best: _Together, ground: GroundGroups, sums: ResidualSums, testable: BoolArray,
    limit: float,
) -> _Together:  # fmt: skip
    """Return the test of a strip's shift alone in place of one with a drift that is not significant itself.

    Where weights are reduced the statistic of both together overrates the drift.
    """
    found = _estimated(ground, sums, best, testable)
    names = dict(zip(best.columns, best.components, strict=True))
    drifts = [place for place, column in enumerate(found.columns) if names[column][1]]
    if not drifts:
        return best
    of_drifts = np.linalg.pinv(found.covariance[np.ix_(drifts, drifts)])
    quantity = float(found.size[drifts] @ of_drifts @ found.size[drifts])
    if chi_square_tail(quantity, float(len(drifts))) < limit:
        return best
    return next(test for test in tests if test.columns == best.groups)


def _common(ground: GroundGroups, sums: ResidualSums, test: _Together, testable: BoolArray) -> tuple[CommonError, ...]:
    """Return the errors in all components of stations; none of other groups, or where none can be tested."""
    of_stations = any(test.group in strip.groups for strip in ground.strips)
    if not of_stations or not testable[list(test.columns)].any():
        return ()
    found = _estimated(ground, sums, test, testable)
    names = dict(zip(test.columns, test.components, strict=True))
    return tuple(
        CommonError(*names[column], float(one), float(deviation))
        for column, one, deviation in zip(found.columns, found.size, np.sqrt(np.diag(found.covariance)), strict=True)
    )
