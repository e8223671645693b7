"""The perspective: cases that a hand can draw."""

from __future__ import annotations

import numpy as np
import pytest

from orip.geometry.perspective import perspective_with_partials
from orip.geometry.rotation import rotation_from_angles


def image_of(point, centre=(0.0, 0.0, 0.0), angles=(0.0, 0.0, 0.0), principal_distance=100.0):
    offset = np.array([point], dtype=float) - np.array(centre, dtype=float)
    rotation = rotation_from_angles(np.radians([angles]))
    return perspective_with_partials(offset, rotation, np.array([principal_distance]))


def test_aerial_photo_shows_east_on_the_right_and_north_at_the_top():
    # 1000 m above ground with C = 100 mm: the photo scale is 1 : 10 000, 50 m are 5 mm
    image = image_of((1050.0, 2030.0, 200.0), centre=(1000.0, 2000.0, 1200.0))
    assert image.in_front[0]
    assert np.allclose(image.xy, [[5.0, 3.0]], atol=1e-12)


def test_photo_turned_by_kappa_shows_its_x_axis_along_that_direction():
    # the x axis of a photo with kappa = 90 points to +Y
    assert np.allclose(image_of((0.0, 40.0, -100.0), angles=(0.0, 0.0, 90.0)).xy, [[40.0, 0.0]], atol=1e-12)


def test_camera_that_looks_north_shows_east_on_the_right_and_up_at_the_top():
    image = image_of((3.0, 10.0, 2.0), angles=(90.0, 0.0, 0.0))
    assert image.in_front[0]
    assert np.allclose(image.xy, [[30.0, 20.0]], atol=1e-12)


@pytest.mark.parametrize(
    ("phi", "kappa", "point"),
    [
        # looking to +X with the photo's y axis up: left of it is north
        (-90.0, -90.0, (10.0, -3.0, 2.0)),
        # looking to -X: right of it is north
        (90.0, 90.0, (-10.0, 3.0, 2.0)),
    ],
)
def test_camera_that_looks_along_x_shows_up_at_the_top_and_no_mirror_image(phi, kappa, point):
    image = image_of(point, angles=(0.0, phi, kappa))
    assert image.in_front[0]
    assert np.allclose(image.xy, [[30.0, 20.0]], atol=1e-12)


def test_image_is_not_mirrored_in_any_attitude():
    # three points seen counter-clockwise from the camera stay counter-clockwise in the image
    generator = np.random.default_rng(4)
    triangle = np.array([[0.0, 0.0, -10.0], [1.0, 0.0, -10.0], [0.0, 1.0, -10.0]])
    for angles in generator.uniform(-np.pi, np.pi, (50, 3)):
        rotation = rotation_from_angles(angles)
        image = perspective_with_partials(triangle @ rotation.T, np.array([rotation] * 3), np.full(3, 50.0))
        (ax, ay), (bx, by) = image.xy[1] - image.xy[0], image.xy[2] - image.xy[0]
        assert ax * by - ay * bx == pytest.approx(25.0, rel=1e-12)


def test_points_behind_and_beside_the_camera_are_not_in_front():
    offset = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0], [1.0, 0.0, -1e-7], [1.0, 0.0, -1e-5]])
    image = perspective_with_partials(offset, np.array([np.eye(3)] * 5), np.full(5, 100.0))
    assert image.in_front.tolist() == [False, False, False, False, True]
    assert np.isfinite(image.xy).all()
    assert np.isfinite(image.by_point).all()


def test_image_does_not_depend_on_the_ground_unit():
    offset = np.array([[3.0, -4.0, -20.0]])
    rotation = rotation_from_angles(np.array([[0.1, -0.2, 0.3]]))
    metres = perspective_with_partials(offset, rotation, np.array([50.0]))
    feet = perspective_with_partials(offset / 0.3048, rotation, np.array([50.0]))
    assert np.allclose(metres.xy, feet.xy, rtol=1e-14)


def test_some_rows_are_those_of_the_whole():
    offset = np.array([[1.0, 2.0, -10.0], [3.0, 1.0, -20.0], [0.0, 0.0, 5.0]])
    image = perspective_with_partials(offset, np.array([np.eye(3)] * 3), np.array([10.0, 20.0, 30.0]))
    chosen = image.of(np.array([False, True, True]))
    assert np.array_equal(chosen.xy, image.xy[1:])
    assert np.array_equal(chosen.by_rotation, image.by_rotation[1:])
    assert chosen.in_front.tolist() == [True, False]
