"""Points that keep to a wrong ray are taken to where most of their rays meet."""

from __future__ import annotations

import numpy as np
import pytest
from support.synthetic_block import synthetic_block

from orip.adjustment.normals import solve_normals
from orip.adjustment.weights import danish_costs, danish_weights
from orip.bundle.points.consensus import PointRays, points_by_photos_alone, with_steady_weights
from orip.bundle.problem import pose_problem
from orip.bundle.starting_state import starting_state
from orip.structs import replace

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


def rays_with_wrong_ones(points, rays, wrong):
    """Return linearised rays of points, some of them wrong by 4 to 40 limits, and their true moves."""
    random = np.random.default_rng(20261122)
    partials = random.normal(size=(points, 2 * rays, 3))
    moves = random.normal(size=(points, 3))
    residuals = random.normal(size=(points, 2 * rays)) - np.einsum("qij,qj->qi", partials, moves)
    for axis in range(wrong):
        residuals[:, 2 * axis] += LIMIT * random.uniform(4.0, 40.0, points)
    return PointRays(partials, residuals)


def lengths(residuals):
    return np.linalg.norm(residuals.reshape(len(residuals), -1, 2), axis=2)


def test_at_steady_weights_the_robust_cost_has_no_slope():
    rays = rays_with_wrong_ones(200, 7, 2)
    moves = with_steady_weights(rays, LIMIT)
    found = rays.after(moves)
    weights = np.repeat(danish_weights(lengths(found), LIMIT), 2, axis=1)
    slope = np.einsum("qji,qj->qi", rays.partials, weights * found)
    # the sum of 14 terms of about 1; where weights became steady slowly, a part of it is left
    assert np.quantile(np.abs(slope).max(axis=1), 0.95) < 1e-2
    before, after = (danish_costs(lengths(some), LIMIT).sum(axis=1) for some in (rays.residuals, found))
    assert (after <= before + 1e-9).all()


def test_points_without_a_wrong_ray_move_to_their_least_squares():
    rays = rays_with_wrong_ones(50, 5, 0)
    partials, residuals = rays
    expected = [
        np.linalg.lstsq(matrix, -right, rcond=None)[0] for matrix, right in zip(partials, residuals, strict=True)
    ]
    fits = (lengths(rays.after(np.array(expected))) <= LIMIT).all(axis=1)
    # conditions of 10 x 3 random partials are below 100, and the normal equations square them
    assert np.allclose(with_steady_weights(rays, LIMIT)[fits], np.array(expected)[fits], rtol=0.0, atol=1e-6)
    assert np.count_nonzero(fits) > 40


def test_a_point_that_only_one_ray_fits_is_left_out(made):
    block = made.block
    problem = pose_problem(block)
    truth = state_at_the_truth(made, block)
    equations = problem.linearise(truth)
    weights = np.ones(len(equations.residual))
    factors = solve_normals(equations, weights, problem.layout, 10).blocks
    assert problem.without_contradictory_blocks(truth, factors, 1.0, weights) is None
    point = int(np.flatnonzero(points_by_photos_alone(block, problem.unknowns))[0])
    rays = np.flatnonzero(block.photo_points.point == point)[1:]
    weights[(2 * rays[:, None] + np.arange(2)).ravel()] = 1e-6
    found = problem.without_contradictory_blocks(truth, factors, 1.0, weights)
    assert np.flatnonzero(found.left_out).tolist() == [point]
