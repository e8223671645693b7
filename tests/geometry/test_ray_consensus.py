"""Points where most of their rays meet: half of the rays may be wrong."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from orip.geometry.rays import PhotoRays, intersect_rays, rival_positions, where_most_rays_meet

C, ERROR = 100.0, 0.005
POINT = np.array([3.0, -2.0, 1.0])


def rays_of(wrong: list[int], count: int = 6) -> PhotoRays:
    """Return rays of one point from photos 100 above it that look down, some of them to another place of the ground."""
    random = np.random.default_rng(1)
    centres = np.column_stack([random.uniform(-40.0, 40.0, (count, 2)), np.full(count, 100.0)])
    rotations = Rotation.from_euler("XYZ", random.normal(0.0, 3.0, (count, 3)), degrees=True).as_matrix()
    seen = np.tile(POINT, (count, 1))
    seen[wrong] += random.uniform(5.0, 20.0, (len(wrong), 3))
    u = np.einsum("ni,nij->nj", seen - centres, rotations)
    xy = -C * u[:, :2] / u[:, 2:] + ERROR * random.normal(size=(count, 2))
    return PhotoRays(centres, rotations, np.column_stack([xy, np.full(count, -C)]), np.full(count, ERROR))


@pytest.mark.parametrize("wrong", [[], [0], [1, 4], [0, 2, 5]])
def test_position_is_that_of_the_right_rays(wrong):
    start = np.full((1, 3), np.nan)
    found = where_most_rays_meet(rays_of(wrong), np.zeros(6, dtype=np.int64), start, 3.5)
    # two rays of 5 µm at 100 m and C 100 mm: 5 mm across, and three times that in height at bases of a third
    assert np.linalg.norm(found[0] - POINT) < 0.1


def test_position_is_where_all_right_rays_meet():
    wrong, start = [0, 5], np.full((1, 3), np.nan)
    rays = rays_of(wrong)
    right = rays.of(np.setdiff1d(np.arange(6), wrong))
    directions = (right.rotations @ right.vectors[:, :, None])[:, :, 0]
    (expected,) = intersect_rays(right.centres, directions, np.zeros(4, dtype=np.int64), 1)
    found = where_most_rays_meet(rays, np.zeros(6, dtype=np.int64), start, 3.5)
    assert np.allclose(found[0], expected, rtol=0.0, atol=1e-9)


def test_rival_position_is_that_of_the_rays_that_do_not_fit():
    elsewhere = np.array([10.0, 4.0, -6.0])
    rays = rays_of([])
    u = np.einsum("ni,nij->nj", elsewhere - rays.centres[3:], rays.rotations[3:])
    vectors = rays.vectors.copy()
    vectors[3:, :2] = -C * u[:, :2] / u[:, 2:]
    fitting = np.arange(6)[None] < 3
    (found,) = rival_positions(rays._replace(vectors=vectors), np.arange(6)[None], fitting, 3.5)
    assert np.linalg.norm(found - elsewhere) < 1e-6


def test_no_rival_position_where_all_rays_fit():
    rows = np.arange(6)[None]
    assert np.isnan(rival_positions(rays_of([]), rows, np.ones((1, 6), dtype=bool), 3.5)).all()


def test_point_on_which_as_many_rays_agree_stays():
    start = POINT[None] + 0.002
    assert np.array_equal(where_most_rays_meet(rays_of([3]), np.zeros(6, dtype=np.int64), start, 3.5), start)


def test_of_two_rays_none_is_called_wrong():
    start = np.full((1, 3), np.nan)
    assert np.isnan(where_most_rays_meet(rays_of([0], 2), np.zeros(2, dtype=np.int64), start, 3.5)).all()


def test_residuals_are_infinite_behind_the_photo():
    rays = rays_of([])
    assert np.isinf(rays.squares(np.tile([0.0, 0.0, 500.0], (6, 1)))).all()
