"""Planes of many groups of points at once, against the singular values of each group by itself."""

from __future__ import annotations

import numpy as np

from orip.geometry.figures import fitted_planes


def test_each_group_has_the_plane_of_its_singular_value_decomposition() -> None:
    random = np.random.default_rng(5)
    group = random.permutation(np.repeat(np.arange(6), 12))
    far_off = np.array([4.5e6, 5.4e6, 300.0])  # coordinates of a country
    points = far_off + random.normal(size=(len(group), 3)) * (400.0, 300.0, 5.0) + 500.0 * group[:, None]
    planes = fitted_planes(points, group, 7)
    places = far_off + random.normal(size=(4, 3)) * 1000.0
    for number in range(6):
        own = points[group == number]
        _, singular, axes = np.linalg.svd(own - own.mean(axis=0))
        found = planes.beside(places, number)
        np.testing.assert_allclose(np.abs(found), np.abs((places - own.mean(axis=0)) @ axes[2]), atol=1e-6)
        np.testing.assert_allclose(planes.extent[number], np.sort(singular) / np.sqrt(len(own)), rtol=1e-8)
    assert planes.number.tolist() == [12] * 6 + [0]


def test_each_place_may_be_compared_with_its_own_plane() -> None:
    level = np.array([[0.0, 0.0, 1.0], [9.0, 0.0, 1.0], [0.0, 9.0, 1.0], [9.0, 9.0, 1.0]])
    planes = fitted_planes(np.vstack([level, level + np.array([0.0, 0.0, 4.0])]), np.repeat([0, 1], 4), 2)
    np.testing.assert_allclose(np.abs(planes.beside(np.array([[3.0, 3.0, 3.0], [3.0, 3.0, 8.0]]))), [2.0, 3.0])
