"""Which rays are kept of photos with very many."""

from __future__ import annotations

import numpy as np

from orip.prelim.rays import ImageRays, thinned


def rays_of(photos, points_a_photo, points, seed=1):
    random = np.random.default_rng(seed)
    point = np.concatenate([random.choice(points, points_a_photo, replace=False) for _ in range(photos)])
    count = len(point)
    return ImageRays(
        tuple(f"P{number}" for number in range(photos)),
        tuple(str(number) for number in range(points)),
        np.repeat(np.arange(photos), points_a_photo),
        point,
        np.zeros((count, 2)),
        random.normal(size=(count, 3)),
        np.full(count, 0.005),
    )


def test_photos_with_few_points_keep_all():
    rays = rays_of(5, 40, 400)
    assert thinned(rays, np.zeros(400, dtype=bool), 30) is rays


def test_each_photo_keeps_enough_and_known_points_stay():
    rays = rays_of(6, 600, 1500)
    known = np.zeros(1500, dtype=bool)
    known[[3, 700, 1499]] = True
    found = thinned(rays, known, 30)
    assert len(found.photo) < 0.5 * len(rays.photo)
    assert np.bincount(found.photo, minlength=6).min() >= 30
    for point in np.flatnonzero(known):
        assert (found.point == found.points.index(str(point))).sum() == (rays.point == point).sum()


def test_a_point_keeps_all_of_its_rays_and_they_stay_what_they_were():
    rays = rays_of(6, 600, 1500)
    found = thinned(rays, np.zeros(1500, dtype=bool), 30)
    assert np.array_equal(np.unique(found.point), np.arange(len(found.points)))
    for point, name in enumerate(found.points):
        assert (found.point == point).sum() == (rays.point == int(name)).sum()
    before = {(p, q): tuple(v) for p, q, v in zip(rays.photo, rays.point, rays.vectors, strict=True)}
    after = zip(found.photo, found.point, found.vectors, strict=True)
    assert all(before[p, int(found.points[q])] == tuple(v) for p, q, v in after)
    again = thinned(rays, np.zeros(1500, dtype=bool), 30)
    assert np.array_equal(found.point, again.point)


def test_points_with_most_rays_come_first():
    rays = rays_of(6, 600, 1500)
    found = thinned(rays, np.zeros(1500, dtype=bool), 30)
    number = np.bincount(rays.point, minlength=1500)
    kept = np.array(found.points, dtype=np.int64)
    assert number[kept].mean() > number[np.setdiff1d(np.unique(rays.point), kept)].mean()
