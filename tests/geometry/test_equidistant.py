"""The equidistant projection: published formulas by hand, directions of 90 degrees and more, and its inverse."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from orip.geometry import equidistant, perspective
from orip.geometry.projection import projected_with_partials
from orip.interior.distortion import distorted_with_partials

C = 9.0


def image(u):
    """Return ideal coordinates (n, 2) of points U (n, 3)."""
    return np.stack(equidistant.ideal_coordinates(C, *np.asarray(u, dtype=float).T), axis=1)


@pytest.mark.parametrize("degrees", [0.001, 1.0, 30.0, 60.0, 89.0, 90.0, 91.0, 120.0, 170.0])
def test_the_distance_from_the_principal_point_goes_with_the_angle(degrees):
    angle, around = math.radians(degrees), 0.7
    u = 5.0 * np.array([[math.sin(angle) * math.cos(around), math.sin(angle) * math.sin(around), -math.cos(angle)]])
    expected = C * angle * np.array([[math.cos(around), math.sin(around)]])
    assert np.allclose(image(u), expected, rtol=0.0, atol=1e-14)


def test_opencv_fisheye_by_its_published_formula():
    """x = a X, y = b X; r² = a² + b², theta = atan r, theta_d = theta (1 + k1 theta² + ...), x' = theta_d a / r."""
    fx, cx, cy = 1210.0, 1003.2, 747.9
    k1, k2, k3, k4 = 0.0431, -0.0127, 0.0061, -0.00138
    random = np.random.default_rng(2)
    x, y, z = random.uniform([-3.0, -3.0, 0.4], [3.0, 3.0, 2.0], (50, 3)).T
    a, b = x / z, y / z
    r = np.sqrt(a * a + b * b)
    theta = np.arctan(r)
    theta_d = theta * (1.0 + k1 * theta**2 + k2 * theta**4 + k3 * theta**6 + k4 * theta**8)
    column, row = fx * theta_d / r * a + cx, fx * theta_d / r * b + cy

    pitch = 0.0025
    c = fx * pitch
    coefficients = (0.0, k1 / c**2, k2 / c**4, k3 / c**6, k4 / c**8, 0.0, 0.0, 0.0, 0.0)
    ideal = equidistant.ideal_coordinates(c, x, -y, -z)
    measured = np.stack(distorted_with_partials(coefficients, *ideal)[:2])
    # coordinates below 5 mm are rounded to 1e-15 mm, some ten times each
    assert np.abs(measured[0] / pitch + cx - column).max() < 1e-11
    assert np.abs(-measured[1] / pitch + cy - row).max() < 1e-11


def test_near_the_axis_it_is_the_perspective():
    # theta - tan(theta) = -theta³ / 3: 3e-13 of C at 1e-4 rad
    u = np.array([[1e-4, -5e-5, -1.0], [0.0, 0.0, -2.0], [1e-170, 0.0, -1.0]])
    plane = np.stack(perspective.ideal_coordinates(C, *u.T), axis=1)
    assert np.allclose(image(u), plane, rtol=0.0, atol=C * 5e-13)
    assert np.array_equal(image(u)[1], [0.0, 0.0])


@given(st.floats(0.0, 170.0), st.floats(-math.pi, math.pi), st.floats(0.01, 1e4))
def test_the_vector_of_an_image_leads_back_to_the_point(degrees, around, distance):
    angle = math.radians(degrees)
    unit = (math.sin(angle) * math.cos(around), math.sin(angle) * math.sin(around), -math.cos(angle))
    x, y = equidistant.ideal_coordinates(C, *(distance * component for component in unit))
    back = equidistant.image_vector(C, x, y)
    assert np.allclose(np.array(back) / C, unit, rtol=0.0, atol=2e-15)
    arrays = equidistant.image_vector(C, np.array([x]), np.array([y]))
    assert np.allclose(np.concatenate(arrays), back, rtol=0.0, atol=1e-14)


def test_straight_behind_the_camera_nothing_is_shown():
    limit = equidistant.LARGEST_ANGLE
    for angle, shown in ((math.radians(90.0), True), (limit - 1e-6, True), (limit + 1e-6, False), (math.pi, False)):
        u = (math.sin(angle), 0.0, -math.cos(angle))
        assert equidistant.is_in_front(*u) is shown
        assert np.asarray(equidistant.is_in_front(*np.array([u]).T)).tolist() == [shown]
        assert math.isnan(equidistant.image_vector(C, C * angle, 0.0)[0]) is not shown
    assert not equidistant.is_in_front(0.0, 0.0, 0.0)
    behind = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, -1.0]])
    found = projected_with_partials(behind, np.array([np.eye(3)] * 2), np.full(2, C), np.array([True, True]))
    assert found.in_front.tolist() == [False, True]
    assert all(np.isfinite(part).all() for part in found)


def test_each_point_has_the_projection_of_its_camera():
    offset = np.array([[1.0, 2.0, -4.0], [1.0, 2.0, -4.0], [3.0, 1.0, 2.0]])
    turned = np.array([np.eye(3)] * 3)
    found = projected_with_partials(offset, turned, np.full(3, C), np.array([False, True, True]))
    assert found.xy[0] == pytest.approx(C * np.array([0.25, 0.5]))
    assert found.xy[1:] == pytest.approx(image(offset[1:]))
    assert found.in_front.tolist() == [True, True, True]
