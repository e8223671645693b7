"""Step control: where the full correction leads away it is damped, and the minimum stays the same."""

from __future__ import annotations

import numpy as np
import pytest
from adjustment.factorisation.linear_systems import CurvedProblem, adjusted, converged, equations_of, settings

from orip.adjustment.convergence import StepControl
from orip.adjustment.equations import Layout
from orip.adjustment.normals import solve_normals
from orip.adjustment.precision import cofactors


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
    assert not any(record.step_limited for record in found.iterations)
    # Newton's iteration for arctan(x) = 0, x - (1 + x²) arctan(x)
    x = start
    for _ in found.iterations:
        x -= (1.0 + x * x) * np.arctan(x)
    assert found.state[0] == pytest.approx(x, abs=1e-12)


@pytest.mark.parametrize("start", [-4.0, -5.0])
def test_where_they_run_away_they_are_damped_and_the_minimum_is_found(start):
    # the first full correction, exp(-x) - 1, would raise the square sum by more than 40 decades
    problem = CurvedProblem(lambda x: 1e4 * np.exp(x), lambda x: 1e4 * np.exp(x)[:, None], np.full(1, 1e4), unknowns=1)
    found = adjusted(problem, np.array([start]), settings())
    assert converged(found)
    assert found.iterations[0].step_limited
    assert found.state[0] == pytest.approx(0.0, abs=1e-8)
    assert not found.iterations[-1].step_limited


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


def control_at(problem, before, normals, damping=0.0):
    """Return the control that judges an attempt from `before`."""
    return StepControl(problem.layout.unknowns, damping).judging(before, np.ones(1), normals)


def test_losing_observations_is_no_improvement():
    problem, state = arctangent(1.0)
    before = problem.linearise(state)
    normals = solve_normals(before, np.ones(1), problem.layout, 12.0)
    after = problem.linearise(state * 10.0)
    after.active[:] = False
    control = control_at(problem, before, normals)
    assert control.accepts_correction(before, problem.linearise(state * 0.5), np.ones(1), normals)
    worse = equations_of(np.ones((1, 1)), before.residual * 0.1)
    control = control_at(problem, worse, normals)
    assert control.accepts_correction(worse, worse, np.ones(1), normals)
    control = control.judging(before, np.ones(1), normals)
    assert not control.accepts_correction(before, after, np.ones(1), normals)
    assert control.accepts_correction(worse, before, np.ones(1), normals)
    assert not control.accepts_fitted(worse, before, np.ones(1), normals)


def test_a_full_correction_after_which_blocks_were_fitted_must_bring_a_tenth_of_the_predicted_decrease():
    problem, state = arctangent(1.0)
    before = problem.linearise(state)
    # one observation, one unknown: the whole square sum is predicted to go
    normals = solve_normals(before, np.ones(1), problem.layout, 12.0)
    control = control_at(problem, before, normals)
    little, enough = (equations_of(np.ones((1, 1)), before.residual * np.sqrt(left)) for left in (0.91, 0.89))
    assert not control.accepts_fitted(before, little, np.ones(1), normals)
    assert control.accepts_fitted(before, enough, np.ones(1), normals)
    assert control.accepts_correction(before, little, np.ones(1), normals)
    assert control.strengthened().accepts_fitted(before, little, np.ones(1), normals)


def test_iterations_count_as_undamped_from_the_one_after_a_refusal():
    control = StepControl(1).refused().strengthened()
    assert control.damping > 0.0
    taken = control.relaxed()
    assert taken.undamped == 0
    assert taken.damping < control.damping
    assert taken.relaxed().undamped == 1


def test_figures_of_a_solution_are_not_those_of_damped_normal_equations(monkeypatch):
    monkeypatch.setattr(StepControl, "accepts_correction", lambda *_: False)
    monkeypatch.setattr(StepControl, "accepts_fitted", lambda control, *_: control.damping > 0.0)
    problem, state = arctangent(0.1)
    found = adjusted(problem, state, settings(max_iterations=12))
    last = found.iterations[-1]
    assert last.step_limited
    assert last.enp >= 3.0
    undamped = solve_normals(found.equations, found.weight_factors, problem.layout, 12.0)
    assert cofactors(found.equations, found.normals).leverage == pytest.approx(
        cofactors(found.equations, undamped).leverage, rel=1e-9
    )
