"""Homographies and orientations from planes in any place."""

from __future__ import annotations

import numpy as np
import pytest
from support.seen_points import rotation_of, seen

from orip.geometry.plane import homography, plane_orientations

SQUARE = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])


def mapped(matrix, plane):
    found = np.column_stack([plane, np.ones(len(plane))]) @ matrix.T
    return found[:, :2] / found[:, 2:]


def test_unit_square_to_a_trapezium_worked_by_hand():
    # (x, y) -> (x, y) / (1 + y / 2)
    image = np.array([[-2.0, -2.0], [2.0, -2.0], [2.0 / 3.0, 2.0 / 3.0], [-2.0 / 3.0, 2.0 / 3.0]])
    found = homography(SQUARE, image)
    assert np.allclose(found / found[0, 0], [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.5, 1.0]], atol=1e-13)


def test_large_coordinates_cost_few_digits():
    generator = np.random.default_rng(1)
    plane = np.array([4.5e6, 5.3e6]) + generator.uniform(0.0, 100.0, (20, 2))
    image = generator.normal(0.0, 1.0, (3, 3))
    image[2] = [1e-9, 2e-9, 1.0]
    expected = mapped(image, plane)
    # the coordinates themselves are rounded to 1e-9, and the image is a million wide
    assert np.allclose(mapped(homography(plane, expected), plane), expected, rtol=1e-9)


def test_four_points_with_three_on_a_line_still_fix_it_no_more_do():
    with pytest.raises(ValueError, match="3 points, 4 are needed"):
        homography(SQUARE[:3], SQUARE[:3])
    line = np.array([[0.0, 0.0], [1.0, 0.0], [2.0, 0.0], [3.0, 0.0], [1.0, 5.0]])
    with pytest.raises(ValueError, match="one line"):
        homography(line, line)


@pytest.mark.parametrize("view", [(5.0, -3.0, 120.0), (90.0, 0.0, 0.0), (0.0, 90.0, 0.0), (-60.0, 30.0, 200.0)])
@pytest.mark.parametrize("tilt", [0.0, 25.0, -50.0])
def test_first_orientation_is_the_truth(view, tilt):
    generator = np.random.default_rng(4)
    rotation, centre = rotation_of(*view), np.array([100.0, 200.0, 300.0])
    plane = (
        rotation_of(tilt, tilt / 2.0, 0.0) @ np.column_stack([generator.uniform(-5.0, 5.0, (12, 2)), np.zeros(12)]).T
    )
    points = centre + (rotation @ (plane + np.array([[1.0], [2.0], [-20.0]]))).T
    found = plane_orientations(seen(points, rotation, centre, 50.0), points)
    assert np.allclose(found.centres[0], centre, atol=1e-9)
    assert np.allclose(found.rotations[0], rotation, atol=1e-10)
    assert np.linalg.det(found.rotations) == pytest.approx(1.0)


def test_second_orientation_is_the_reversal_that_fits_a_distant_plane():
    """Seen from far the image of a tilted plane is also that of the plane tilted the other way."""
    points = np.column_stack([3.0 * SQUARE, np.zeros(4)])
    rotation = rotation_of(0.0, 30.0, 0.0)
    centre = rotation @ [0.0, 0.0, 1000.0]
    found = plane_orientations(seen(points, rotation, centre, 50.0), points)
    assert np.allclose(found.centres[1], centre * [-1.0, 1.0, 1.0], atol=1e-6)
    residual = seen(points, found.rotations[1], found.centres[1], 50.0) - seen(points, rotation, centre, 50.0)
    assert 0.0 < np.abs(residual).max() < 1e-3


def test_nearly_plane_points_give_nearly_the_truth():
    generator = np.random.default_rng(5)
    rotation, centre = rotation_of(3.0, -2.0, 45.0), np.array([0.0, 0.0, 1500.0])
    points = generator.uniform([-900.0, -900.0, 0.0], [900.0, 900.0, 30.0], (20, 3))
    found = plane_orientations(seen(points, rotation, centre, 150.0), points)
    assert np.linalg.norm(found.centres[0] - centre) < 60.0
    assert np.abs(found.rotations[0] - rotation).max() < 0.05
