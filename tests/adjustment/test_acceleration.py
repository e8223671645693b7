"""Acceleration: slow, linear convergence becomes fast; the solution and quick problems stay as they are."""

from __future__ import annotations

from unittest.mock import patch

import numpy as np
import pytest
from adjustment.factorisation.linear_systems import CurvedProblem, adjusted, converged, settings

from orip.adjustment.convergence import AcceleratedStep, Acceleration


def without_acceleration():
    return patch.object(
        Acceleration, "step", lambda _, normals, __: AcceleratedStep(normals.correction, Acceleration())
    )


def contraction(*rates):
    """Return a problem whose every correction leaves `rates` of the way to the solution, and the solution.

    Its partials are too large by 1 / (1 - rate).
    """
    size = len(rates)
    target = np.arange(1.0, size + 1.0)
    design = np.eye(size) + 0.1
    partials = design / (1.0 - np.array(rates))
    return CurvedProblem(lambda x: design @ x, lambda _: partials, design @ target, None, size), target


def circle_fit():
    """Return a fit of centre and radius to a small arc with large errors: residuals make Gauss-Newton slow."""
    random = np.random.default_rng(51)
    turn = np.linspace(0.0, 1.2, 40)
    points = 10.0 * np.stack([np.cos(turn), np.sin(turn)], axis=1) + 0.6 * random.normal(size=(40, 2))

    def computed(x):
        return (np.hypot(*(points - x[:2]).T) - x[2]) / 0.1

    def partials(x):
        offset = points - x[:2]
        return np.hstack([-offset / np.hypot(*offset.T)[:, None], -np.ones((40, 1))]) / 0.1

    return CurvedProblem(computed, partials, np.zeros(40), None, 3)


@pytest.mark.parametrize("rates", [(0.9,), (0.9, 0.6), (-0.8, 0.85, 0.5), (0.95, 0.95)])
def test_a_linear_contraction_is_followed_to_its_end_in_far_fewer_steps(rates):
    problem, target = contraction(*rates)
    start = target + 0.3
    chosen = settings(enp_stop=8.0, max_iterations=1000)
    fast = adjusted(problem, start, chosen)
    with without_acceleration():
        slow = adjusted(problem, start, chosen)
    assert converged(fast)
    assert converged(slow)
    assert len(fast.iterations) <= 10 + 2 * len(rates)
    assert len(fast.iterations) < len(slow.iterations) / 3
    assert np.allclose(fast.state, target, atol=1e-7)
    assert np.allclose(slow.state, target, atol=1e-6)


def test_a_fit_with_large_residuals_ends_at_the_same_point():
    start = np.array([0.5, 0.5, 9.0])
    chosen = settings(enp_stop=7.0, max_iterations=300)
    fast = adjusted(circle_fit(), start, chosen)
    with without_acceleration():
        slow = adjusted(circle_fit(), start, chosen)
    assert converged(fast)
    assert converged(slow)
    assert len(fast.iterations) < 0.7 * len(slow.iterations)
    assert np.allclose(fast.state, slow.state, atol=1e-5)


def test_a_problem_that_converges_quickly_is_not_changed():
    def computed(x):
        return np.array([np.exp(0.1 * x[0]), x[0] + x[1], x[1] * x[1]]) / 1e-3

    def partials(x):
        return np.array([[0.1 * np.exp(0.1 * x[0]), 0.0], [1.0, 1.0], [0.0, 2.0 * x[1]]]) / 1e-3

    problem = CurvedProblem(computed, partials, computed(np.array([1.0, 2.0])), None, 2)
    start = np.array([0.7, 2.5])
    fast = adjusted(problem, start, settings(enp_stop=9.0))
    with without_acceleration():
        plain = adjusted(problem, start, settings(enp_stop=9.0))
    assert converged(fast)
    assert [iteration.enp for iteration in fast.iterations] == [iteration.enp for iteration in plain.iterations]
    assert np.array_equal(fast.state, plain.state)
