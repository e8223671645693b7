"""Intersection of rays: exact cases, parallel rays, large coordinates."""

from __future__ import annotations

import numpy as np
import pytest

from orip.geometry.rays import intersect_rays


def intersect(origins, directions, index=None, count=1):
    origins, directions = np.array(origins, dtype=float), np.array(directions, dtype=float)
    index = np.zeros(len(origins), dtype=np.int64) if index is None else np.array(index, dtype=np.int64)
    return intersect_rays(origins, directions, index, count)


def test_two_rays_that_meet():
    found = intersect([[0, 0, 10], [10, 0, 10]], [[5, 2, -10], [-5, 2, -10]])
    assert np.allclose(found, [[5.0, 2.0, 0.0]], atol=1e-13)


def test_skew_rays_meet_halfway_between_them():
    # along x at height 0, along y at height 2
    assert np.allclose(intersect([[5, 0, 0], [0, -3, 2]], [[1, 0, 0], [0, 7, 0]]), [[0.0, 0.0, 1.0]], atol=1e-13)


def test_rays_of_several_points_in_any_order():
    found = intersect(
        [[0, 0, 10], [1, 1, 10], [10, 0, 10], [11, 1, 10]],
        [[5, 2, -10], [5, 2, -10], [-5, 2, -10], [-5, 2, -10]],
        index=[1, 0, 1, 0],
        count=2,
    )
    assert np.allclose(found, [[6.0, 3.0, 0.0], [5.0, 2.0, 0.0]], atol=1e-13)


def test_point_with_one_ray_none_or_parallel_rays_has_no_position():
    found = intersect(
        [[0, 0, 0], [0, 0, 0], [1, 0, 0], [0, 0, 0], [1, 0, 0]],
        [[0, 0, 1], [1, 2, 3], [2, 4, 6], [1, 2, 3], [-1, -2, -3]],
        index=[0, 1, 1, 2, 2],
        count=4,
    )
    assert np.isnan(found).all()


def test_no_rays_at_all():
    assert np.isnan(intersect(np.empty((0, 3)), np.empty((0, 3)), count=2)).all()


def test_length_of_the_directions_does_not_count():
    origins = [[0, 0, 10], [10, 0, 10], [3, 8, 12]]
    directions = np.array([[5, 2, -10], [-5, 2.1, -10], [2, -6, -11.5]], dtype=float)
    lengths = np.array([[1e-6], [1.0], [1e6]])
    assert np.allclose(intersect(origins, directions), intersect(origins, directions * lengths), atol=1e-12)


def test_national_grid_coordinates_cost_no_digits():
    grid = np.array([1e6, 5e6, 400.0])
    point = np.array([123.456789, 987.654321, 12.345678])
    origins = np.array([[0.0, 0.0, 1000.0], [600.0, 0.0, 1010.0], [300.0, 500.0, 990.0]])
    found = intersect(origins + grid, point - origins)
    # the coordinates themselves are rounded to 1e-9; an intersection with squares of 5e6 would lose 3 mm
    assert np.allclose(found - grid, point, atol=5e-9)


def test_small_base_of_two_distant_rays_still_meets():
    # an angle of 1e-4 at the point: far from parallel to working precision
    found = intersect([[0, 0, 0], [0.1, 0, 0]], [[0, 0, 1000], [-0.1, 0, 1000]])
    assert found[0, 2] == pytest.approx(1000.0, rel=1e-6)


def test_least_squares_of_many_rays_is_scipys():
    from scipy.optimize import least_squares

    generator = np.random.default_rng(7)
    origins = generator.uniform([-50.0, -50.0, 50.0], [50.0, 50.0, 150.0], (6, 3))
    directions = generator.normal(0.0, 2.0, (6, 3)) - origins
    unit = directions / np.linalg.norm(directions, axis=1, keepdims=True)

    def distances(x):
        return np.cross(x - origins, unit).ravel()

    expected = least_squares(distances, np.zeros(3), xtol=1e-15, ftol=1e-15, gtol=1e-15).x
    assert np.allclose(intersect(origins, directions)[0], expected, atol=1e-8)
