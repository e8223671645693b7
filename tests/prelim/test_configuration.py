"""Areas of image points against areas worked by hand, and what is said of them."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from orip.prelim.resection.known_points import hull_area, image_configuration, on_one_line


def test_triangle_of_the_manual():
    # half of base times height
    assert hull_area(np.array([[0.0, 0.0], [6.0, 0.0], [2.0, 4.0]])) == pytest.approx(12.0, abs=1e-14)


def test_points_inside_do_not_count():
    square = [[0.0, 0.0], [2.0, 0.0], [2.0, 2.0], [0.0, 2.0], [1.0, 1.0], [0.5, 1.2], [1.0, 0.0]]
    assert hull_area(np.array(square)) == pytest.approx(4.0, abs=1e-14)


@pytest.mark.parametrize("seed", range(5))
def test_area_is_that_of_qhull(seed):
    xy = np.random.default_rng(seed).normal(0.0, 50.0, (30, 2))
    assert hull_area(xy) == pytest.approx(ConvexHull(xy).volume, rel=1e-13)


def test_one_point_two_points_and_equal_points_have_no_area():
    assert hull_area(np.array([[1.0, 2.0]])) == 0.0
    assert hull_area(np.array([[1.0, 2.0], [5.0, 7.0]])) == 0.0
    assert hull_area(np.array([[1.0, 2.0]] * 4)) == 0.0


def test_five_percent_of_an_aerial_photo():
    # 26.45 cm² of 23 cm x 23 cm
    corner = np.sqrt(2.0 * 2645.0)
    xy = np.array([[0.0, 0.0], [corner, 0.0], [0.0, corner]])
    just = image_configuration(1.0001 * xy, (230.0, 230.0), xy)
    short = image_configuration(0.99 * xy, (230.0, 230.0), xy)
    assert just.area_share == pytest.approx(0.05, rel=1e-3)
    assert just.shortcoming is None
    assert short.shortcoming == (
        "the known points span 4.9% of the photo, 5% are wanted: measure more known points, farther apart"
    )


def test_without_a_frame_the_extent_of_all_measured_points_stands_for_it():
    measured = np.array([[-10.0, -5.0], [10.0, 5.0], [0.0, 0.0]])
    found = image_configuration(np.array([[0.0, 0.0], [4.0, 0.0], [0.0, 5.0]]), None, measured)
    assert found.area_share == pytest.approx(10.0 / 200.0, abs=1e-15)


def test_points_on_one_line_are_told():
    xy = np.array([[0.0, 0.0], [50.0, 50.01], [100.0, 100.0]])
    assert on_one_line(xy)
    assert image_configuration(xy, (230.0, 230.0), xy).shortcoming == "the known points lie on one line in the photo"
    assert not on_one_line(np.array([[0.0, 0.0], [50.0, 51.0], [100.0, 100.0]]))
    assert on_one_line(np.array([[1.0, 2.0, 3.0]] * 5))
    assert on_one_line(np.array([[1.0, 2.0, 3.0], [2.0, 4.0, 6.0]]))
