"""Points that keep to a wrong ray are taken to where most of their rays meet."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support.synthetic_block import synthetic_block

from orip.bundle.problem import pose_problem, starting_state

LIMIT = 5.0


@pytest.fixture(scope="module")
def made():
    return synthetic_block("convergent", "consensus", noise_mm=0.005)


def state_at_the_truth(made, block):
    return replace(starting_state(block), points=made.points.copy(), centres=made.orientations[:, :3].copy())


def with_a_wrong_ray(made, rays, wrong_mm):
    """Return the block with so many rays of one point, the first of them wrong, and that point."""
    points = made.block.photo_points
    numbers = np.bincount(points.point)
    point = int(np.flatnonzero(numbers >= rays)[1])
    mine = np.flatnonzero(points.point == point)
    used, xy = points.used.copy(), points.xy.copy()
    used[mine[rays:]] = False
    xy[mine[0]] += wrong_mm
    return replace(made.block, photo_points=replace(points, used=used, xy=xy)), point


def pulled(problem, state, block, point):
    """Return the state with the point where its wrong ray and one more have it: a compromise of two rays."""
    points = block.photo_points
    mine = np.flatnonzero(points.point == point)[:2]
    equations = problem.linearise(state)
    rows = (2 * mine[:, None] + np.arange(2)).ravel()
    columns = problem.unknowns.points[point]
    move, *_ = np.linalg.lstsq(equations.design[rows][:, columns].toarray(), -equations.residual[rows], rcond=None)
    moved = state.points.copy()
    moved[point] += move
    return replace(state, points=moved)


@pytest.mark.parametrize("rays", [4, 5, 6])
def test_a_point_at_the_wrong_ray_goes_back(made, rays):
    block, point = with_a_wrong_ray(made, rays, np.array([0.3, -0.4]))
    problem = pose_problem(block)
    truth = state_at_the_truth(made, block)
    wrong = pulled(problem, truth, block, point)
    assert np.linalg.norm(wrong.points[point] - made.points[point]) > 1e-3
    found = problem.improve_consensus(wrong, problem.linearise(wrong), LIMIT)
    # two rays of 5 um at 4 m and C 50 mm meet within some 0.4 mm; the blunder had moved the point by millimetres
    assert np.linalg.norm(found.points[point] - made.points[point]) < 1.5e-3
    others = np.arange(len(made.points)) != point
    assert np.array_equal(found.points[others], wrong.points[others])
    assert np.array_equal(found.centres, wrong.centres)


def test_a_point_that_most_rays_hold_stays(made):
    block, _ = with_a_wrong_ray(made, 5, np.array([0.3, -0.4]))
    problem = pose_problem(block)
    truth = state_at_the_truth(made, block)
    assert problem.improve_consensus(truth, problem.linearise(truth), LIMIT) is None


def test_two_rays_say_nothing(made):
    block, point = with_a_wrong_ray(made, 2, np.array([0.3, -0.4]))
    problem = pose_problem(block)
    wrong = pulled(problem, state_at_the_truth(made, block), block, point)
    assert problem.improve_consensus(wrong, problem.linearise(wrong), LIMIT) is None
