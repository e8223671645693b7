"""Probabilities of square sums and means against scipy.stats and closed forms, far out too."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from orip.adjustment.outlier_tests import (
    against_others,
    chi_square_tail,
    generalised_square_tail,
    largest_of,
    square_sum_tail,
    two_sided_normal,
)


@pytest.mark.parametrize("statistic", [0.0, -1.0, 3.0, 30.0])
def test_the_normal_distribution(statistic):
    assert two_sided_normal(statistic) == pytest.approx(np.log(2.0) + stats.norm.logsf(abs(statistic)), rel=1e-12)


@pytest.mark.parametrize(("statistic", "freedom"), [(16.5, 2.5), (0.1, 4.0), (300.0, 200.0), (900.0, 40.0)])
def test_the_chi_square_distribution(statistic, freedom):
    assert chi_square_tail(statistic, freedom) == pytest.approx(stats.chi2.logsf(statistic, freedom), rel=1e-9)


@pytest.mark.parametrize("freedom", [1.0, 10.0, 15000.0])
def test_where_probabilities_underflow_the_larger_statistic_is_still_the_less_probable(freedom):
    statistics = freedom + np.sqrt(2.0 * freedom) * np.geomspace(10.0, 2000.0, 200)
    tails = [chi_square_tail(statistic, freedom) for statistic in statistics]
    assert tails == sorted(tails, reverse=True)
    assert np.isfinite(tails).all()


def test_equal_variances_make_a_square_sum_chi_square():
    assert square_sum_tail(2.0 * 12.0, 2.0 * np.eye(5)) == pytest.approx(stats.chi2.logsf(12.0, 5), rel=1e-9)


@pytest.mark.parametrize("p", [0.3, 0.05, 0.001])
def test_unequal_variances(p):
    # two pairs of equal variances: a sum of two exponential variables of means 2a and 2b, whose tail is a closed form
    a, b = 0.9, 0.1

    def tail(x: float) -> float:
        return (a * np.exp(-x / (2.0 * a)) - b * np.exp(-x / (2.0 * b))) / (a - b)

    x = np.interp(-p, [-tail(value) for value in np.linspace(0.0, 30.0, 3001)], np.linspace(0.0, 30.0, 3001))
    # an approximation by three moments
    assert np.exp(square_sum_tail(float(x), np.diag([a, a, b, b]))) == pytest.approx(p, rel=0.1)


def test_residuals_that_cannot_vary_are_no_evidence():
    assert square_sum_tail(1e-20, np.zeros((3, 3))) == 0.0


def test_correlated_differences_together():
    covariance = np.array([[2.0, 1.2], [1.2, 1.0]])
    quantity, tail = generalised_square_tail(np.array([1.0, -1.0]), covariance)
    # by hand: the determinant is 0.56, and the inverse [[1, -1.2], [-1.2, 2]] over it
    assert quantity == pytest.approx((1.0 + 2.0 * 1.2 + 2.0) / 0.56)
    assert tail == pytest.approx(stats.chi2.logsf(quantity, 2))


def test_a_residual_against_what_the_others_predict():
    covariance = np.array([[2.0, 1.2], [1.2, 1.0]])
    found = against_others(np.array([1.0, -1.0]), covariance)
    # the regression of the first on the second is 1.2, what is left of its variance 2 - 1.44
    assert found[0] == pytest.approx((1.0 + 1.2) / np.sqrt(0.56))
    assert found[1] == pytest.approx((1.0 + 0.6) / np.sqrt(1.0 - 1.44 / 2.0))


def test_the_largest_of_many_is_no_surprise():
    assert largest_of(np.log(0.001), 10) == pytest.approx(np.log(0.01))
    assert largest_of(np.log(0.4), 10) == 0.0
