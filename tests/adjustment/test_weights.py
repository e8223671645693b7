"""The Danish weight factors: values of the formula, when they begin, when they are off."""

from __future__ import annotations

import numpy as np
import pytest

from orip.adjustment.weights import DanishWeights


def test_values_above_and_below_the_limit():
    found = DanishWeights(5.0, 2).factors(np.array([0.0, 4.999, 5.0, 5.001, 6.0, 10.0, 20.0]), 2)
    assert found[:3].tolist() == [1.0, 1.0, 1.0]
    # docs/conventions.md: exp(-u / c)
    assert found[3:] == pytest.approx([0.3678, 0.3012, 0.1353, 0.0183], abs=1e-4)


@pytest.mark.parametrize(("u", "factor"), [(3.1, 0.36), (6.0, 0.135), (10.0, 0.036), (20.0, 0.0013)])
def test_values_with_limit_3(u, factor):
    assert DanishWeights(3.0, 2).factors(np.array([u]), 5)[0] == pytest.approx(factor, rel=0.03)


@pytest.mark.parametrize(("iteration", "reduced"), [(1, False), (2, False), (3, True), (4, True)])
def test_nothing_is_down_weighted_before_the_start(iteration, reduced):
    factor = DanishWeights(5.0, 3).factors(np.array([50.0]), iteration)[0]
    assert (factor < 1.0) == reduced


def test_a_gigantic_residual_keeps_a_trace_of_weight():
    assert DanishWeights(5.0, 2).factors(np.array([1e9]), 2).tolist() == [1e-30]


def test_factors_depend_on_the_residual_alone_so_that_observations_come_back():
    weights = DanishWeights(5.0, 2)
    assert weights.factors(np.array([12.0]), 3)[0] < 1.0
    assert weights.factors(np.array([4.0]), 4)[0] == 1.0


def test_no_observations():
    assert DanishWeights(5.0, 2).factors(np.zeros(0), 2).shape == (0,)
