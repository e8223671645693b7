"""The Danish weight factors: values of the formula, and those while a state settles."""

from __future__ import annotations

import numpy as np
import pytest

from orip.adjustment.weights import (
    danish_costs,
    danish_weights,
    greatest_danish_cost,
    robust_scale,
    wide_costs,
    wide_weights,
)


def test_values_above_and_below_the_limit():
    found = danish_weights(np.array([0.0, 4.999, 5.0, 5.001, 6.0, 10.0, 20.0]), 5.0)
    assert found[:3].tolist() == [1.0, 1.0, 1.0]
    # docs/conventions.md: exp(-u / c)
    assert found[3:] == pytest.approx([0.3678, 0.3012, 0.1353, 0.0183], abs=1e-4)


@pytest.mark.parametrize(("u", "factor"), [(3.1, 0.36), (6.0, 0.135), (10.0, 0.036), (20.0, 0.0013)])
def test_values_with_limit_3(u, factor):
    assert danish_weights(np.array([u]), 3.0)[0] == pytest.approx(factor, rel=0.03)


def steep(standard_residuals, limit):
    return wide_weights(standard_residuals, limit, 3)


@pytest.mark.parametrize("weights", [danish_weights, steep])
def test_a_gigantic_residual_keeps_a_trace_of_weight_and_no_influence(weights):
    size = np.array([1e4, 1e7, 1e10])
    found = weights(size, 1.0)
    assert (found > 0.0).all()
    assert (found * size**2 <= 0.01 * (1.0 + 1e-12)).all()
    assert danish_weights(np.array([1e3]), 5.0).tolist() == [1e-10]


@pytest.mark.parametrize("weights", [danish_weights, steep])
def test_no_observations(weights):
    assert weights(np.zeros(0), 5.0).shape == (0,)


def test_wide_weights_fall_with_the_square_or_the_cube():
    found = [wide_weights(np.array([4.9, 5.0, 10.0, 50.0, 1e6]), 5.0, exponent).tolist() for exponent in (2, 3)]
    assert found[0] == pytest.approx([1.0, 1.0, 0.25, 1e-2, 2.5e-11], rel=1e-9, abs=0.0)
    assert found[1] == pytest.approx([1.0, 1.0, 0.125, 1e-3, 1e-14], rel=1e-9, abs=0.0)


@pytest.mark.parametrize(("weights", "costs"), [(danish_weights, danish_costs), (steep, wide_costs)])
def test_costs_are_the_integral_of_residual_times_weight(weights, costs):
    # by the trapezoidal rule; its error is the jump of the Danish weights times half a step, 5 * 0.63 * 0.0005
    u = np.arange(0.0, 60.0, 0.001)
    influence = u * weights(u, 5.0)
    integral = np.concatenate([[0.0], np.cumsum((influence[1:] + influence[:-1]) * 0.0005)])
    assert costs(u, 5.0) == pytest.approx(integral, abs=2e-3)


def test_no_residual_costs_more_than_the_greatest_cost():
    assert danish_costs(np.array([1e9]), 5.0)[0] == pytest.approx(greatest_danish_cost(5.0))


def test_the_scale_of_normal_residuals_is_their_standard_deviation():
    random = np.random.default_rng(5)
    sizes = np.abs(2.1 * random.normal(size=20000))
    # the median of 20000 is known to 0.8 %; three times that
    assert robust_scale(sizes) == pytest.approx(2.1, rel=0.025)
    # with a fifth replaced by anything the median is what the quantile 0.625 of the normal ones was
    sizes[:4000] = 1e9
    assert robust_scale(sizes) == pytest.approx(2.1 * 0.8871 / 0.6745, rel=0.025)
