"""Rival places of points: the rays that meet there, and what else observes a control point."""

from __future__ import annotations

import numpy as np
import pytest
from support.synthetic_block import synthetic_block

from orip.bundle.problem import pose_problem
from orip.bundle.starting_state import starting_state
from orip.records.control import ControlPoint
from orip.structs import replace

LIMIT, NOISE_MM = 5.0, 0.005
RIVAL = [2, 4, 7]
"""Rays of the first point that show another place, of eight."""


def with_rival_place(control_error: float | None = None):
    """Return the problem of a block with a rival place of one point, the point, that place and the state at the truth.

    With a control error the point is a control point, whose coordinates are those of the rival place.
    """
    made = synthetic_block("convergent", "rivals", noise_mm=0.0, precision_mm=NOISE_MM)
    points, free = (
        made.block.photo_points,
        ~np.isin(made.block.point_names, [p.name for p in made.block.control_points]),
    )
    point = int(np.flatnonzero(free)[0])
    elsewhere = made.points[point] + np.array([0.05, -0.04, 0.06])
    truth = replace(made.block, photo_orientation=made.orientations, point_start=made.points)
    moved = replace(truth, point_start=np.where(np.arange(len(free))[:, None] == point, elsewhere, made.points))
    problem = pose_problem(moved)
    computed = problem.linearise(starting_state(moved)).residual[: points.xy.size].reshape(-1, 2) * points.error
    rays = np.flatnonzero(points.point == point)[RIVAL]
    xy = points.xy.copy()
    # residuals are computed minus observed
    xy[rays] += computed[rays]
    block = replace(truth, photo_points=replace(points, xy=xy))
    if control_error is not None:
        name = block.point_names[point]
        control = ControlPoint(name, tuple(elsewhere.tolist()), (control_error,) * 3)
        block = replace(block, control_points=(*block.control_points, control))
    return pose_problem(block), point, elsewhere, starting_state(block)


@pytest.mark.parametrize("control_error", [None, 0.001])
def test_rival_place_is_where_the_rays_meet_that_have_no_weight(control_error: float | None) -> None:
    problem, point, elsewhere, state = with_rival_place(control_error)
    equations = problem.linearise(state)
    weights = np.where(np.abs(equations.residual) > LIMIT, 1e-10, 1.0)
    rays = np.flatnonzero(problem.block.photo_points.point == point)
    weights[2 * rays[RIVAL]] = weights[2 * rays[RIVAL] + 1] = 1e-10
    if control_error is None:
        # of eight rays five meet where the point is: three cost more by two rays than those
        assert not problem.rival_places(state, equations, weights, LIMIT)
        out = 2 * rays[[0, 1]]
        active = equations.active.copy()
        active[out] = active[out + 1] = False
        equations = replace(equations, active=active)
    (place,) = problem.rival_places(state, equations, weights, LIMIT)
    # photo coordinates are exact, the place is two corrections of Newton from where two rays meet
    assert np.allclose(state.points[point] + place.move, elsewhere, rtol=0.0, atol=1e-9)
    kept = place.rows[place.weights >= 1.0].tolist()
    of_rays = np.sort(np.r_[2 * rays[RIVAL], 2 * rays[RIVAL] + 1]).tolist()
    control = np.arange(len(weights))[len(weights) - 3 :].tolist() if control_error else []
    assert kept[: len(of_rays)] == of_rays
    assert len(kept) == len(of_rays) + len(control)
    assert np.abs(place.residual[place.weights >= 1.0]).max() < 1e-6


@pytest.mark.parametrize(("here", "found"), [(2, 1), (3, 0)])
def test_two_wrong_rays_that_meet_do_not_hold_a_point_without_a_trial(here: int, found: int) -> None:
    """Two of four rays meet elsewhere; where three meet, two are no rival."""
    problem, point, _, state = with_rival_place()
    equations = problem.linearise(state)
    rays = np.flatnonzero(problem.block.photo_points.point == point)
    fitting = np.setdiff1d(np.arange(len(rays)), RIVAL)[:here]
    taking_part = np.concatenate([fitting, RIVAL[:2]])
    weights, active = np.ones(len(equations.residual)), equations.active.copy()
    for ray in range(len(rays)):
        rows = [2 * rays[ray], 2 * rays[ray] + 1]
        active[rows] = ray in taking_part
        weights[rows] = 1.0 if ray in fitting else 1e-10
    assert len(problem.rival_places(state, replace(equations, active=active), weights, LIMIT)) == found


def test_no_rival_place_where_all_rays_fit() -> None:
    made = synthetic_block("convergent", "rivals", noise_mm=NOISE_MM)
    problem, state = pose_problem(made.block), starting_state(made.block)
    equations = problem.linearise(state)
    assert not problem.rival_places(state, equations, np.ones(len(equations.residual)), LIMIT)
