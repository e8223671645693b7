"""ENP, divergence and steadiness of weights."""

from __future__ import annotations

import numpy as np
import pytest
from adjustment.factorisation.linear_systems import adjusted, linear_problem, settings

from orip.adjustment.convergence import (
    ENP_LIMIT,
    exponent_of_numerical_precision,
    is_diverging,
    weights_are_steady,
)


@pytest.mark.parametrize(("square_sum", "unknowns", "enp"), [(4.0, 4, 0.0), (1e-8, 1, 4.0), (500.0, 5, -1.0)])
def test_enp_counts_the_digits_by_which_corrections_undercut_deviations(square_sum, unknowns, enp):
    assert exponent_of_numerical_precision(square_sum, unknowns) == pytest.approx(enp)


def test_enp_of_corrections_that_vanish_or_run_away():
    assert exponent_of_numerical_precision(0.0, 7) == ENP_LIMIT
    assert exponent_of_numerical_precision(1e-40, 7) == ENP_LIMIT
    assert exponent_of_numerical_precision(np.inf, 7) == -np.inf
    assert exponent_of_numerical_precision(np.nan, 7) == -np.inf
    assert exponent_of_numerical_precision(0.0, 0) == ENP_LIMIT


def test_enp_of_an_iteration_is_that_of_the_drop_of_the_square_sum():
    random = np.random.default_rng(41)
    design, observed = random.normal(size=(30, 4)), random.normal(size=30)
    found = adjusted(linear_problem(design, observed), np.ones(4), settings())
    solution = np.linalg.lstsq(design, observed, rcond=None)[0]
    drop = np.sum((design @ np.ones(4) - observed) ** 2) - np.sum((design @ solution - observed) ** 2)
    assert found.iterations[0].enp == pytest.approx(-0.5 * np.log10(drop / 4))


@pytest.mark.parametrize(
    ("enps", "diverging"),
    [
        ([-1.0], False),
        ([1.0, 0.0, -1.0], False),
        ([-1.0, -2.0, -1.5, -3.0], False),
        ([0.0, -1.0, -2.0, -3.0], True),
        ([1.0, 0.5, 0.3, -0.1], True),
        ([5.0, 0.0, -1.0, -2.0, -3.0], True),
        ([2.0, -np.inf], True),
        ([], False),
    ],
)
def test_three_falls_running_to_below_zero_are_divergence(enps, diverging):
    assert is_diverging(enps) is diverging


def test_falling_enp_is_no_divergence_while_corrections_are_smaller_than_deviations():
    # a robust adjustment of a strip with blunders in points of two rays, which moved on to its end state at ENP 7
    assert not is_diverging([0.5, 0.6, 0.7, 1.5, 1.4, 1.1, 0.9, 0.7])


@pytest.mark.parametrize(("change", "steady"), [(0.0, True), (0.049, True), (0.051, False), (-0.3, False)])
def test_weights_are_steady_when_none_changes_by_more_than_a_twentieth(change, steady):
    before = np.array([1.0, 0.5, 0.2])
    assert weights_are_steady(before, before + np.array([0.0, change, 0.0])) is steady


def test_no_weights_are_steady():
    assert weights_are_steady(np.zeros(0), np.zeros(0))
