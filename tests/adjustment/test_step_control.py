"""Step control: where the full correction leads away it is damped, and the minimum stays the same."""

from __future__ import annotations

import numpy as np
import pytest
from adjustment.linear_systems import CurvedProblem, adjusted, converged, equations_of, settings

from orip.adjustment.equations import Layout
from orip.adjustment.normals import solve_normals
from orip.adjustment.step_control import StepControl


def arctangent(start_off: float) -> tuple[CurvedProblem, np.ndarray]:
    """Return a problem with the minimum 0."""
    problem = CurvedProblem(
        lambda x: 1e4 * np.arctan(x), lambda x: np.array([[1e4 / (1.0 + x[0] ** 2)]]), np.zeros(1), unknowns=1
    )
    return problem, np.array([start_off])


@pytest.mark.parametrize("start", [0.5, 1.3])
def test_where_full_corrections_lead_on_none_is_damped(start):
    problem, state = arctangent(start)
    found = adjusted(problem, state, settings())
    assert converged(found)
    assert not any(record.step_limited for record in found.passes)
    # Newton's iteration for arctan(x) = 0, x - (1 + x²) arctan(x)
    x = start
    for _ in found.passes:
        x -= (1.0 + x * x) * np.arctan(x)
    assert found.linearised.state[0] == pytest.approx(x, abs=1e-12)


@pytest.mark.parametrize("start", [-4.0, -5.0])
def test_where_they_run_away_they_are_damped_and_the_minimum_is_found(start):
    # the first full correction, exp(-x) - 1, would raise the square sum by more than 40 decades
    problem = CurvedProblem(lambda x: 1e4 * np.exp(x), lambda x: 1e4 * np.exp(x)[:, None], np.full(1, 1e4), unknowns=1)
    found = adjusted(problem, np.array([start]), settings())
    assert converged(found)
    assert found.passes[0].step_limited
    assert found.linearised.state[0] == pytest.approx(0.0, abs=1e-8)
    assert not found.passes[-1].step_limited


def test_damping_multiplies_the_whole_diagonal():
    random = np.random.default_rng(1)
    design = np.zeros((40, 10))
    design[:, :4] = random.normal(size=(40, 4))
    for row in range(40):
        design[row, 4 + 3 * (row % 2) : 7 + 3 * (row % 2)] = random.normal(size=3)
    observed = random.normal(size=40)
    equations = equations_of(design, -observed)
    layout = Layout(4, 2, np.zeros(10, dtype=bool))
    found = solve_normals(equations, np.ones(40), layout, 12.0, 0.3)
    normals = design.T @ design
    wanted = np.linalg.solve(normals + 0.3 * np.diag(np.diag(normals)), design.T @ observed)
    assert np.allclose(found.correction, wanted, rtol=1e-12)


def test_observations_that_go_out_of_sight_are_no_gain():
    problem, state = arctangent(1.0)
    before = problem.linearise(state)
    control = StepControl(problem.layout)
    normals = solve_normals(before, np.ones(1), problem.layout, 12.0)
    after = problem.linearise(state * 10.0)
    after.active[:] = False
    assert control.accepts(before, problem.linearise(state * 0.5), np.ones(1), normals, full=True)
    control = StepControl(problem.layout)
    worse = equations_of(np.ones((1, 1)), before.residual * 0.1)
    assert control.accepts(worse, worse, np.ones(1), normals, full=True)
    assert not control.accepts(before, after, np.ones(1), normals, full=True)
    assert control.accepts(worse, before, np.ones(1), normals, full=True)
    assert not control.accepts(worse, before, np.ones(1), normals, full=False)


def test_a_full_correction_that_needed_help_must_bring_a_tenth_of_what_was_predicted():
    problem, state = arctangent(1.0)
    before = problem.linearise(state)
    control = StepControl(problem.layout)
    # one observation, one unknown: the whole square sum is predicted to go
    normals = solve_normals(before, np.ones(1), problem.layout, 12.0)
    little, enough = (equations_of(np.ones((1, 1)), before.residual * np.sqrt(left)) for left in (0.91, 0.89))
    assert not control.accepts(before, little, np.ones(1), normals, full=False)
    assert control.accepts(before, enough, np.ones(1), normals, full=False)
    assert control.accepts(before, little, np.ones(1), normals, full=True)
    control.strengthen()
    assert control.accepts(before, little, np.ones(1), normals, full=False)
