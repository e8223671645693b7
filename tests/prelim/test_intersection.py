"""Intersection of all points: exact rays, wrong rays, parallel rays, standard deviations."""

from __future__ import annotations

import numpy as np
import pytest
from support.seen_points import rays_of, rotation_of

from orip.prelim.rays import SMALLEST_ANGLE, intersect
from orip.structs import replace

GRID = np.array([400_000.0, 5_300_000.0, 0.0])


def strip(photos=5, points=300, noise_mm=0.005, seed=1, base=600.0, rows=1):
    """A strip (or more) flown at 1500 m with a camera 150 mm / 230 mm."""
    generator = np.random.default_rng(seed)
    centres = np.array([[base * i, 1600.0 * row, 1500.0] for row in range(rows) for i in range(photos)]) + GRID
    rotations = np.stack([rotation_of(*generator.normal(0.0, 2.0, 3)) for _ in centres])
    ground = (
        generator.uniform([0.0, -900.0, 0.0], [base * (photos - 1), 1600.0 * rows - 700.0, 150.0], (points, 3)) + GRID
    )
    return rays_of(ground, rotations, centres, 150.0, 230.0, generator, noise_mm), rotations, centres, ground


def solve(rays, rotations, centres, oriented=None):
    return intersect(rotations, centres, np.ones(len(centres), dtype=bool) if oriented is None else oriented, rays)


def number_of_rays(rays):
    return np.bincount(rays.point, minlength=len(rays.points))


def test_exact_rays_meet_in_the_points():
    rays, rotations, centres, ground = strip(noise_mm=0.0)
    found = solve(rays, rotations, centres)
    seen_twice = number_of_rays(rays) >= 2
    assert seen_twice.sum() > 250
    # national grid coordinates are rounded to 1e-9
    assert np.allclose(found.coordinates[seen_twice], ground[seen_twice], atol=1e-6)
    assert np.isnan(found.coordinates[~seen_twice]).all()
    assert (found.weight_factors[seen_twice[rays.point]] == 1.0).all()
    assert found.s0 == 1.0


def test_standard_deviations_are_those_of_monte_carlo():
    errors = []
    for seed in range(15):
        rays, rotations, centres, ground = strip(points=400, seed=seed)
        found = solve(rays, rotations, centres)
        errors.append(((found.coordinates - ground) / found.deviations)[np.isfinite(found.coordinates).all(axis=1)])
    ratio = np.sqrt(np.mean(np.concatenate(errors) ** 2, axis=0))
    # off the principal point, up to 45 degrees here, an error in the photo turns the ray by less than error / length
    assert (ratio < 1.03).all()
    assert (ratio > 0.80).all()


@pytest.mark.parametrize("count", [3, 4, 5, 12])
def test_one_wrong_ray_is_thrown_out(count):
    generator = np.random.default_rng(count)
    centres = np.column_stack(
        [np.linspace(-10.0, 10.0, count), generator.uniform(-3.0, 3.0, count), np.full(count, 30.0)]
    )
    rotations = np.stack([rotation_of(*generator.normal(0.0, 3.0, 3)) for _ in centres])
    ground = generator.uniform(-3.0, 3.0, (200, 3))
    rays = rays_of(ground, rotations, centres, 50.0, 60.0, generator, 0.005)
    wrong = np.array([generator.choice(np.flatnonzero(rays.point == point)) for point in range(40)])
    moved = rays.vectors.copy()
    moved[wrong, :2] += generator.uniform(1.0, 5.0, (40, 2)) * generator.choice([-1.0, 1.0], (40, 2))
    found = solve(replace(rays, vectors=moved), rotations, centres)
    error = np.linalg.norm(found.coordinates - ground, axis=1)
    good = np.ones(len(rays.point), dtype=bool)
    good[wrong] = False
    # 0.005 mm are 3 mm; a wrong ray misses by a metre. Of three rays it may by chance meet one of the others.
    assert np.mean(error < 0.1) >= (0.9 if count == 3 else 1.0)
    assert np.mean(found.weight_factors[wrong] < 0.1) >= (0.9 if count == 3 else 1.0)
    assert np.mean(found.weight_factors[good] == 1.0) > 0.9


def test_two_rays_that_do_not_meet_give_no_point():
    rays, rotations, centres, _ = strip(photos=2, points=50, noise_mm=0.0)
    moved = rays.vectors.copy()
    first = np.flatnonzero(rays.point == rays.point[0])[0]
    moved[first, 1] += 20.0
    found = solve(replace(rays, vectors=moved), rotations, centres)
    assert np.isnan(found.coordinates[rays.point[0]]).all()
    assert np.isfinite(found.coordinates).all(axis=1).sum() > 20


def test_nearly_parallel_rays_give_no_point():
    """A base of 4 m at 1500 m: an angle of 0.15 degrees."""
    rays, rotations, centres, _ = strip(photos=2, points=50, base=4.0)
    found = solve(rays, rotations, centres)
    seen_twice = number_of_rays(rays) == 2
    assert seen_twice.any()
    assert np.isnan(found.coordinates).all()
    assert np.isnan(found.deviations).all()
    assert (found.weight_factors == 0.0).all()
    assert ((found.angles[seen_twice] > 0.0) & (found.angles[seen_twice] < SMALLEST_ANGLE)).all()


def test_angle_is_the_largest_between_two_rays():
    rays, rotations, centres, ground = strip(noise_mm=0.0)
    found = solve(rays, rotations, centres)
    for point in range(40):
        photos = rays.photo[rays.point == point]
        to_photos = centres[photos] - ground[point]
        unit = to_photos / np.linalg.norm(to_photos, axis=1, keepdims=True)
        expected = np.arccos(np.clip(unit @ unit.T, -1.0, 1.0)).max() if len(unit) > 1 else 0.0
        assert found.angles[point] == pytest.approx(expected, abs=1e-6)


def test_point_behind_the_photos_is_none():
    """Two photos that look away from where their rays meet."""
    rays, rotations, centres, _ = strip(photos=2, points=30, noise_mm=0.0)
    found = solve(rays, rotations, centres[::-1])
    assert np.isnan(found.coordinates).all()
    assert (found.weight_factors == 0.0).all()


def test_rays_of_photos_that_are_not_oriented_are_left_out():
    rays, rotations, centres, ground = strip(noise_mm=0.0)
    oriented = np.array([True, True, False, True, True])
    lost = np.where(oriented[:, None], centres, np.nan)
    found = solve(rays, rotations, lost, oriented)
    left = np.bincount(rays.point[oriented[rays.photo]], minlength=len(rays.points)) >= 2
    assert np.allclose(found.coordinates[left], ground[left], atol=1e-6)
    assert np.isnan(found.coordinates[~left]).all()
    assert (found.weight_factors[rays.photo == 2] == 0.0).all()


def test_no_oriented_photo():
    rays, rotations, centres, _ = strip(points=20)
    found = solve(rays, rotations, centres, np.zeros(5, dtype=bool))
    assert np.isnan(found.coordinates).all()
    assert found.s0 == 1.0


def test_badly_oriented_photos_do_not_make_all_rays_blunders():
    rays, rotations, centres, ground = strip(photos=6, rows=2, points=400)
    off = centres + np.random.default_rng(3).normal(0.0, 10.0, centres.shape)
    found = solve(rays, rotations, off)
    seen_thrice = number_of_rays(rays) >= 3
    assert found.s0 > 50.0
    assert np.mean(np.linalg.norm(found.coordinates - ground, axis=1)[seen_thrice] < 100.0) > 0.95
