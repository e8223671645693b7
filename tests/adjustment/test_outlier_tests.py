"""Limits of outlier tests against published figures and scipy.stats, and how often clean residuals exceed them."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from orip.adjustment.outlier_tests import OutlierTest
from orip.adjustment.residual_sums import JointEffects

KNOWN = OutlierTest(0.01, 1.0, None)

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
    assert OutlierTest(0.001, 1.0, size).group_limit(size) == np.inf
    # the fall T of a square sum S on 30 degrees of freedom: (T / k) / ((S - T) / (30 - k)) follows F
    limit = OutlierTest(0.001, 1.0, 30).group_limit(size) ** 2
    assert (limit / size) / ((30 - limit) / (30 - size)) == pytest.approx(stats.f.isf(0.001, size, 30 - size))


@pytest.mark.parametrize("freedom", [None, 7, 30])
def test_a_group_of_one_has_the_limit_of_the_normalised_residual(freedom):
    test = OutlierTest(0.001, 1.0, freedom)
    assert test.group_limit(1) == pytest.approx(test.limit(), rel=1e-9)
    assert test.group_limit_of_left_out(1) == pytest.approx(test.limit_of_left_out(), rel=1e-9)


def test_what_is_left_out_has_no_share_in_sigma0_and_follows_student():
    # x and y of a photo point on ten degrees of freedom: Student 5.05, where tau would be 2.75
    test = OutlierTest(0.001, 1.0, 10)
    assert test.limit_of_left_out(2) == pytest.approx(5.05, abs=0.005)
    assert test.limit(2) == pytest.approx(2.75, abs=0.005)
    assert test.limit_of_left_out(2) == pytest.approx(stats.t.isf(0.001 / 4.0, 10))
    assert test.group_limit_of_left_out(3) ** 2 == pytest.approx(3.0 * stats.f.isf(0.001, 3, 10))
    assert OutlierTest(0.001, 1.0, 0).limit_of_left_out() == np.inf
    assert OutlierTest(0.001, 1.0, None).limit_of_left_out(2) == OutlierTest(0.001, 1.0, None).limit(2)


def test_an_observation_at_the_limit_is_at_the_limit_of_taking_back_once_it_is_left_out():
    # both tests are one: the square sum falls by what it would rise by
    for size in (1, 2, 3):
        in_use = OutlierTest(0.001, 1.3, 20)
        change = (in_use.group_limit(size) * in_use.sigma0) ** 2
        left_out = in_use.after(change, size)
        assert np.sqrt(change) / left_out.sigma0 == pytest.approx(left_out.group_limit_of_left_out(size))
        back = left_out.after(-change, -size)
        assert (back.sigma0, back.redundancy) == (pytest.approx(1.3), 20)


@pytest.mark.slow
@pytest.mark.parametrize("a_posteriori", [False, True])
def test_clean_residuals_exceed_the_limits_as_often_as_alpha_says(a_posteriori):
    random = np.random.default_rng(71)
    design = random.normal(size=(15, 5))
    hat = design @ np.linalg.pinv(design)
    runs, alpha = 10_000, 0.01
    failing = dict.fromkeys(("single", "group", "single left out", "group left out"), 0)
    in_use = np.ones(15, dtype=bool)
    for residual in random.normal(size=(runs, 15)) @ (np.eye(15) - hat):
        test = OutlierTest(alpha, float(np.sqrt(residual @ residual / 10)), 10) if a_posteriori else KNOWN
        effects = JointEffects(residual, hat, in_use)
        for size, name in ((1, "single"), (3, "group")):
            places = np.arange(size)
            fall = float(effects.square_sum_changes(places[None]).change[0])
            failing[name] += np.sqrt(fall) > test.sigma0 * test.group_limit(size)
            without = test.after(fall, size)
            failing[f"{name} left out"] += np.sqrt(fall) > without.sigma0 * without.group_limit_of_left_out(size)
    # 100 are expected: four standard deviations of that number
    assert list(failing.values()) == pytest.approx([runs * alpha] * 4, abs=40)
