"""Which weights an iteration has: when the reduced ones begin, and what comes before."""

from __future__ import annotations

import numpy as np
import pytest
from adjustment.factorisation.linear_systems import linear_problem

from orip.adjustment.weights import Weighing, weighing_from

BLUNDER, FAR = 100.0, 60.0


def equations(residuals, exact=None):
    count = len(residuals)
    return linear_problem(np.zeros((count, 1)), -np.array(residuals), exact).linearise(np.zeros(1))


def test_weights_are_reduced_once_the_state_is_settled_and_the_start_is_reached():
    weighing = Weighing(5.0, 3)
    found = equations([FAR] * 9 + [BLUNDER])
    assert (weighing.factors(found, 1) == 1.0).all()
    weighing = weighing.after(1, 1.5, found)
    # settled, but iteration 2 is before the start
    assert (weighing.factors(found, 2) == 1.0).all()
    assert not weighing.is_final_in(2)
    weighing = weighing.after(2, 1.0, found)
    assert weighing.factors(found, 3)[-1] == pytest.approx(np.exp(-BLUNDER / 5.0))
    assert weighing.is_final_in(3)
    assert weighing.iterations_before == 2


def test_weights_wait_for_a_settled_state():
    weighing = Weighing(5.0, 2)
    found = equations([FAR] * 9 + [BLUNDER])
    for iteration in range(1, 5):
        assert (weighing.factors(found, iteration) == 1.0).all()
        weighing = weighing.after(iteration, -1.0, found)
    weighing = weighing.after(5, 1.0, found)
    assert weighing.factors(found, 6)[-1] < 1e-6
    assert weighing.iterations_before == 5


def test_a_state_that_never_settles_is_not_waited_for():
    weighing = Weighing(5.0, 2)
    for iteration in range(1, 8):
        weighing = weighing.after(iteration, 0.9, equations([FAR] * 10))
    assert weighing.settled_after == 7


def settled_after(residuals: list[float]) -> int:
    """Return after which iteration the Danish method begins, where corrections stay large and residuals change so."""
    weighing = Weighing(5.0, 2)
    for iteration, size in enumerate(residuals, 1):
        weighing = weighing.after(iteration, -1.0, equations([size] * 10))
    assert weighing.settled_after is not None
    return weighing.settled_after


def test_a_state_that_is_on_its_way_is_waited_for():
    halves = [1000.0 * 0.5**iteration for iteration in range(12)]
    assert settled_after([*halves, halves[-1], halves[-1]]) == 13


def test_residuals_that_swing_are_not_waited_for():
    # they fall by half in every second iteration, and get nowhere
    assert settled_after([1000.0, 500.0] * 10) == 7


def test_what_sticks_out_of_the_others_loses_weight_from_the_first_iteration_on():
    assert Weighing(5.0, 2).factors(equations([0.5] * 9 + [BLUNDER]), 1)[-1] == pytest.approx((5.0 / BLUNDER) ** 2)


def test_without_a_start_nothing_is_reduced():
    weighing = Weighing(5.0, None)
    assert (weighing.factors(equations([0.5, BLUNDER]), 7) == 1.0).all()
    assert weighing.is_final_in(1)
    assert weighing.iterations_before == 0


def test_what_must_be_met_exactly_keeps_its_weight():
    found = equations([0.5] * 9 + [BLUNDER], np.arange(10) == 9)
    assert (Weighing(5.0, 1).factors(found, 1) == 1.0).all()


def test_without_early_weights_the_danish_method_begins_at_its_iteration():
    """As in ORIPROGRAM: all weights 1 before, those of the method from then on, whatever the corrections are."""
    weighing, found = weighing_from(5.0, 3, early=False), equations([0.5] * 9 + [BLUNDER])
    for iteration in (1, 2):
        assert (weighing.factors(found, iteration) == 1.0).all()
        assert not weighing.is_final_in(iteration)
        weighing = weighing.after(iteration, -2.0, found)
    assert weighing.factors(found, 3)[-1] == pytest.approx(np.exp(-BLUNDER / 5.0))
    assert weighing.is_final_in(3)
    assert weighing_from(5.0, None, early=False) == Weighing(5.0, None)
