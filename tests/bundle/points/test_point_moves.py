"""Points moved in direction and inverse distance, against the same in polar coordinates."""

from __future__ import annotations

import numpy as np
import pytest
from bundle.aerial_block import aerial_block

from orip.bundle.points.consensus import with_points_moved
from orip.bundle.problem import pose_problem
from orip.bundle.starting_state import starting_state
from orip.structs import replace

CENTRES = np.array([[0.0, 0.0, 100.0], [60.0, 0.0, 100.0], [0.0, 40.0, 100.0]])
RAYS = np.array([0, 0, 1, 0])
MIDDLE = np.array([CENTRES[[0, 1, 0]].mean(axis=0), CENTRES[2]])


def moved(points: np.ndarray, move: np.ndarray) -> np.ndarray:
    state = starting_state(aerial_block("moved points", 4).block)
    rays = CENTRES[[0, 1, 2, 0]]
    return with_points_moved(replace(state, points=points), move, rays, RAYS).points


@pytest.mark.parametrize("share", [-3.0, -0.2, 0.4, 0.85])
def test_along_the_ray_the_inverse_distance_changes_linearly(share):
    points = np.array([[10.0, 20.0, 0.0], [-30.0, 5.0, 10.0]])
    away = points - MIDDLE
    found = moved(points, share * away) - MIDDLE
    distance, there = np.linalg.norm(away, axis=1), np.linalg.norm(found, axis=1)
    assert np.allclose(1.0 / there, (1.0 - share) / distance, rtol=1e-12)
    assert np.allclose(found / there[:, None], away / distance[:, None], atol=1e-12)


def test_no_point_goes_through_infinity():
    points = np.array([[10.0, 20.0, 0.0], [-30.0, 5.0, 10.0]])
    away = points - MIDDLE
    assert np.allclose(moved(points, 7.0 * away) - MIDDLE, 10.0 * away, rtol=1e-12)


def test_small_moves_are_those_of_the_coordinates():
    points = np.array([[10.0, 20.0, 0.0], [-30.0, 5.0, 10.0]])
    move = 1e-5 * np.random.default_rng(3).normal(size=(2, 3))
    assert np.allclose(moved(points, move) - points, move, rtol=1e-5, atol=1e-11)
    assert np.array_equal(moved(points, np.zeros((2, 3))), points)


def test_a_problem_moves_its_points_and_nothing_else():
    block = aerial_block("moved points", 4).block
    problem, state = pose_problem(block), starting_state(block)
    columns = problem.unknowns.points
    correction = np.zeros(3 * problem.layout.blocks)
    point = int(np.flatnonzero((columns >= problem.layout.reduced).all(axis=1))[0])
    correction[columns[point] - problem.layout.reduced] = 1e-3
    found = problem.with_blocks_moved(state, correction)
    assert np.array_equal(np.flatnonzero((found.points != state.points).any(axis=1)), [point])
    assert np.allclose(found.points[point] - state.points[point], 1e-3, rtol=1e-3)
    assert np.array_equal(found.centres, state.centres)
    assert np.array_equal(found.cameras, state.cameras)
