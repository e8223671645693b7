"""Limits of outlier tests against published figures and scipy.stats, and how often clean residuals exceed them."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from orip.adjustment.outlier_tests import OutlierTest

# Pope's tau for f degrees of freedom, two-sided
TAU = {
    (5, 0.001): 2.178, (5, 0.01): 2.051, (5, 0.05): 1.814,
    (10, 0.001): 2.679, (10, 0.01): 2.324, (10, 0.05): 1.904,
    (20, 0.001): 2.975, (20, 0.01): 2.454, (20, 0.05): 1.936,
    (50, 0.001): 3.163, (50, 0.01): 2.528, (50, 0.05): 1.951,
    (100, 0.001): 3.226, (100, 0.01): 2.552, (100, 0.05): 1.956,
}  # fmt: skip


@pytest.mark.parametrize(("freedom", "alpha"), TAU)
def test_tau(freedom, alpha):
    assert OutlierTest(alpha, 1.0, freedom).limit() == pytest.approx(TAU[freedom, alpha], abs=6e-4)


@pytest.mark.parametrize(("alpha", "limit"), [(0.001, 3.291), (0.01, 2.576), (0.05, 1.960)])
def test_with_a_known_sigma0_the_limit_is_normal(alpha, limit):
    assert OutlierTest(alpha, 1.0, None).limit() == pytest.approx(limit, abs=6e-4)
    assert OutlierTest(alpha, 1.0, 1_000_000).limit() == pytest.approx(limit, abs=6e-4)


@pytest.mark.parametrize("among", [1, 2, 500])
def test_the_largest_of_several_is_tested_at_their_share_of_alpha(among):
    alpha = 0.001 / among
    assert OutlierTest(0.001, 1.0, None).limit(among) == pytest.approx(stats.norm.isf(alpha / 2.0))
    t = stats.t.isf(alpha / 2.0, 19)
    assert OutlierTest(0.001, 1.0, 20).limit(among) == pytest.approx(np.sqrt(20) * t / np.sqrt(19 + t * t))


@pytest.mark.parametrize("freedom", [0, 1])
def test_sigma0_that_rests_on_one_residual_tests_none(freedom):
    assert OutlierTest(0.001, 1.0, freedom).limit() == np.inf


@pytest.mark.parametrize("size", [1, 2, 3])
def test_limits_of_groups(size):
    assert OutlierTest(0.001, 1.0, None).group_limit(size) == pytest.approx(np.sqrt(stats.chi2.isf(0.001, size)))
    assert OutlierTest(0.001, 1.0, 30).group_limit(size) == pytest.approx(np.sqrt(stats.f.isf(0.001, size, 30 - size)))
    assert OutlierTest(0.001, 1.0, size).group_limit(size) == np.inf


def test_a_group_of_one_with_known_sigma0_is_the_normalised_residual():
    known = OutlierTest(0.001, 1.0, None)
    assert known.group_statistic(np.array([2.0]), np.array([[0.25]])) == pytest.approx(4.0)
    assert known.group_limit(1) == pytest.approx(known.limit())


def test_a_group_that_nothing_checks_cannot_be_tested():
    known = OutlierTest(0.001, 1.0, None)
    assert np.isnan(known.group_statistic(np.array([0.0, 1.0]), np.diag([0.0, 1.0])))
    assert np.isnan(known.group_statistic(np.array([1.0, 1.0]), np.ones((2, 2))))


@pytest.mark.slow
@pytest.mark.parametrize("a_posteriori", [False, True])
def test_clean_residuals_exceed_the_limits_as_often_as_alpha_says(a_posteriori):
    random = np.random.default_rng(71)
    design = random.normal(size=(15, 5))
    projection = np.eye(15) - design @ np.linalg.pinv(design)
    runs, alpha, single, group = 20_000, 0.01, 0, 0
    residuals = random.normal(size=(runs, 15)) @ projection
    for residual in residuals:
        sigma0 = float(np.sqrt(residual @ residual / 10)) if a_posteriori else 1.0
        test = OutlierTest(alpha, sigma0, 10 if a_posteriori else None)
        single += abs(residual[0]) / (sigma0 * np.sqrt(projection[0, 0])) > test.limit()
        group += test.group_statistic(residual[:3], projection[:3, :3]) > test.group_limit(3)
    # 200 are expected: four standard deviations of that number
    assert single == pytest.approx(runs * alpha, abs=57)
    assert group == pytest.approx(runs * alpha, abs=57)
