"""The Danish weight factors: values of the formula, and those while a state settles."""

from __future__ import annotations

import numpy as np
import pytest

from orip.adjustment.weights import danish_weights, scaled_weights


def test_values_above_and_below_the_limit():
    found = danish_weights(np.array([0.0, 4.999, 5.0, 5.001, 6.0, 10.0, 20.0]), 5.0)
    assert found[:3].tolist() == [1.0, 1.0, 1.0]
    # docs/conventions.md: exp(-u / c)
    assert found[3:] == pytest.approx([0.3678, 0.3012, 0.1353, 0.0183], abs=1e-4)


@pytest.mark.parametrize(("u", "factor"), [(3.1, 0.36), (6.0, 0.135), (10.0, 0.036), (20.0, 0.0013)])
def test_values_with_limit_3(u, factor):
    assert danish_weights(np.array([u]), 3.0)[0] == pytest.approx(factor, rel=0.03)


def test_a_gigantic_residual_keeps_a_trace_of_weight():
    assert danish_weights(np.array([1e9]), 5.0).tolist() == [1e-10]


@pytest.mark.parametrize("weights", [danish_weights, scaled_weights])
def test_no_observations(weights):
    assert weights(np.zeros(0), 5.0).shape == (0,)


def test_while_settling_the_limit_follows_what_most_residuals_are():
    far_off = np.full(100, 67.45)
    far_off[:2] = 499.0, 501.0
    # the median of 67.45 is a hundred times that of normal residuals, 0.6745: the limit 5 becomes 500
    found = scaled_weights(far_off, 5.0)
    assert found[0] == 1.0
    assert found[1] == pytest.approx((500.0 / 501.0) ** 2, rel=1e-3)
    assert found[2:].tolist() == [1.0] * 98


def test_while_settling_nothing_comes_loose():
    assert scaled_weights(np.array([0.1, 0.2, 0.3, 1e6]), 5.0)[3] == pytest.approx(25e-12)


def test_small_residuals_do_not_lower_the_limit():
    assert scaled_weights(np.array([1e-6, 1e-6, 1e-6, 4.9]), 5.0).tolist() == [1.0] * 4
