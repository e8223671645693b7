"""Space resection against published examples, known truth, blunders and Monte Carlo."""

from __future__ import annotations

import numpy as np
import pytest
from support.prelim_references.resection import _costs
from support.seen_points import points_seen, rotation_of, seen, with_noise

from orip.prelim.resection.known_points import KnownPoints
from orip.prelim.resection.resection import Resected, Unresected, resect

MIKHAIL = np.array(
    [
        [56.515, -78.969, 913928.64, 575198.44, 189.64],
        [1.242, 1.134, 914270.77, 575432.35, 191.26],
        [95.576, 97.171, 914684.64, 575022.09, 186.72],
        [-70.988, 92.733, 914662.47, 575738.30, 191.94],
        [0.651, -30.068, 914137.97, 575435.45, 190.69],
    ]
)
"""x, y, X, Y, Z of Mikhail, Bethel and McGlone, Introduction to Modern Photogrammetry (2001), C = 152.222 mm."""

WUHAN = np.array(
    [
        [-86.15, -68.99, 36589.41, 25273.32, 2195.17],
        [-53.40, 82.21, 37631.08, 31324.51, 728.69],
        [-14.78, -76.63, 39100.97, 24934.98, 2386.50],
        [10.46, 64.43, 40426.54, 30319.81, 757.31],
    ]
)
"""x, y, X, Y, Z of Zhang, Pan and Wang, Photogrammetry (Wuhan University Press 2003), C = 153.24 mm."""

VIEWS = [
    (0.0, 0.0, 0.0),
    (2.0, -3.0, 170.0),
    (90.0, 0.0, 0.0),
    (0.0, 90.0, 0.0),
    (30.0, -90.0, 0.0),
    (135.0, 40.0, 60.0),
]


def published(table, principal_distance):
    vectors = np.column_stack([table[:, :2], np.full(len(table), -principal_distance)])
    return resected(vectors, table[:, 2:])


def resected(vectors, points, deviation=None, **options) -> Resected:
    found = resect(vectors, points, deviation, **options)
    assert isinstance(found, Resected), found
    return found


def reason(vectors, points) -> str:
    found = resect(vectors, points)
    assert isinstance(found, Unresected)
    return found.reason


def test_example_of_mikhail_bethel_mcglone():
    found = published(MIKHAIL, 152.222)
    # the solution as published with the data: metres, and a square sum of 0.000751 mm²
    assert np.allclose(found.centre, [914260.42186, 575441.83555, 839.13044], atol=1e-4)
    assert np.sum(found.residuals**2) == pytest.approx(0.000751105, abs=1e-9)
    expected = rotation_of(*np.degrees([-0.006507481, -0.008521804, -1.575322124]))
    assert np.allclose(found.rotation, expected, atol=2e-8)
    assert found.redundancy == 4
    assert found.s0 * 0.01 == pytest.approx(np.sqrt(0.000751105 / 4.0), rel=1e-5)


def test_example_of_zhang_pan_wang():
    found = published(WUHAN, 153.24)
    # 39795.45, 27476.46, 7572.69 m; phi -0.00399, omega 0.00211, kappa -0.06758 about Y, X, Z
    assert np.allclose(found.centre, [39795.45, 27476.46, 7572.69], atol=0.006)
    published_rotation = [[0.99771, 0.06753, 0.00399], [-0.06753, 0.99772, -0.00211], [-0.00412, 0.00184, 0.99999]]
    assert np.allclose(found.rotation, published_rotation, atol=1.1e-5)


@pytest.mark.parametrize("view", VIEWS)
@pytest.mark.parametrize("count", [4, 5, 12, 40])
@pytest.mark.parametrize("distances", [(20.0, 40.0), (30.0, 30.0)], ids=["in space", "in a plane"])
def test_exact_points_give_the_truth_in_any_attitude(view, count, distances):
    generator = np.random.default_rng(count)
    rotation, centre = rotation_of(*view), np.array([10.0, -20.0, 5.0])
    points = points_seen(generator, count, rotation, centre, 50.0, 36.0, distances)
    found = resected(seen(points, rotation, centre, 50.0), points)
    assert np.allclose(found.centre, centre, atol=1e-9 * 30.0)
    assert np.allclose(found.rotation, rotation, atol=1e-9)
    assert (found.weight_factor == 1.0).all()


def test_national_grid_coordinates_cost_no_digits():
    generator = np.random.default_rng(1)
    centre = np.array([4_500_000.0, 5_300_000.0, 1500.0])
    points = points_seen(generator, 15, rotation_of(1.0, 2.0, 3.0), centre, 150.0, 230.0, (1400.0, 1500.0))
    found = resected(seen(points, rotation_of(1.0, 2.0, 3.0), centre, 150.0), points)
    # coordinates of five millions are rounded to 1e-9
    assert np.allclose(found.centre, centre, atol=1e-6)


@pytest.mark.parametrize("blunders", [1, 3, 6])
@pytest.mark.parametrize("view", VIEWS[:4])
def test_blunders_are_found_and_do_no_harm(blunders, view):
    generator = np.random.default_rng(blunders)
    rotation, centre = rotation_of(*view), np.array([10.0, -20.0, 5.0])
    points = points_seen(generator, 20, rotation, centre, 50.0, 36.0, (20.0, 40.0))
    vectors = with_noise(generator, seen(points, rotation, centre, 50.0), 0.005)
    vectors[:blunders, :2] += generator.uniform(2.0, 20.0, (blunders, 2))
    found = resected(vectors, points, error_mm=0.005)
    assert (found.weight_factor[:blunders] < 1e-6).all()
    assert (found.weight_factor[blunders:] == 1.0).all()
    assert found.how == f"space resection from 20 points, {blunders} down-weighted"
    # five standard deviations
    assert np.abs(found.centre - centre).max() < 5.0 * found.centre_deviation.max()
    assert np.abs(found.rotation - rotation).max() < 5.0 * found.rotation_deviation.max()


def test_a_camera_that_is_not_calibrated_makes_no_blunders():
    """Camera constant off by 3 % and a barrel distortion of 0.1 mm: residuals far above the a-priori error."""
    generator = np.random.default_rng(7)
    rotation, centre = rotation_of(40.0, 10.0, 0.0), np.array([0.0, 0.0, 50.0])
    points = points_seen(generator, 30, rotation, centre, 35.0, 24.0, (50.0, 90.0))
    vectors = with_noise(generator, seen(points, rotation, centre, 35.0), 0.005)
    vectors[:, :2] *= 1.0 - 0.1 * np.sum(vectors[:, :2] ** 2, axis=1, keepdims=True) / 12.0**3
    vectors[:, 2] *= 1.03
    vectors[4, :2] += [3.0, -4.0]
    found = resected(vectors, points, error_mm=0.005)
    assert found.s0 > 5.0
    assert np.flatnonzero(found.weight_factor < 0.1).tolist() == [4]
    assert np.linalg.norm(found.centre - centre) < 0.06 * 70.0
    assert np.abs(found.rotation - rotation).max() < 0.02


def test_points_behind_the_camera_are_blunders():
    generator = np.random.default_rng(8)
    rotation, centre = rotation_of(90.0, 0.0, 0.0), np.zeros(3)
    points = points_seen(generator, 10, rotation, centre, 50.0, 36.0, (20.0, 40.0))
    vectors = seen(points, rotation, centre, 50.0)
    points[:2] *= -1.0
    found = resected(vectors, points)
    assert np.allclose(found.centre, centre, atol=1e-8)
    assert np.isnan(found.residuals[:2]).all()
    assert np.isfinite(found.residuals[2:]).all()
    assert (found.weight_factor[:2] < 1e-6).all()


def test_less_certain_points_count_less():
    generator = np.random.default_rng(9)
    rotation, centre = rotation_of(0.0, 0.0, 0.0), np.array([0.0, 0.0, 100.0])
    points = points_seen(generator, 20, rotation, centre, 50.0, 36.0, (80.0, 120.0))
    vectors = seen(points, rotation, centre, 50.0)
    deviation = np.where(np.arange(20) < 8, 0.5, 0.0)
    noisy = points + generator.normal(0.0, 1.0, (20, 3)) * deviation[:, None]
    found = resected(vectors, noisy, deviation, error_mm=0.005)
    # 0.5 units are 0.25 mm in the photo, fifty times its error: the others decide
    assert np.linalg.norm(found.centre - centre) < 0.02
    assert found.s0 < 2.0


def test_standard_deviations_are_those_of_monte_carlo():
    generator = np.random.default_rng(10)
    rotation, centre = rotation_of(60.0, 5.0, 20.0), np.array([100.0, 50.0, 20.0])
    points = points_seen(generator, 10, rotation, centre, 50.0, 36.0, (50.0, 100.0))
    vectors = seen(points, rotation, centre, 50.0)
    samples = 300
    found = [resected(with_noise(generator, vectors, 0.01), points, error_mm=0.01) for _ in range(samples)]
    shift = np.array([orientation.centre - centre for orientation in found])
    small = np.array([orientation.rotation @ rotation.T for orientation in found])
    turn = np.stack([small[:, 2, 1], small[:, 0, 2], small[:, 1, 0]], axis=1)
    expected = np.sqrt(
        np.mean(
            [np.square([*orientation.centre_deviation, *orientation.rotation_deviation]) for orientation in found],
            axis=0,
        )
    )
    scatter = np.sqrt(np.mean(np.hstack([shift, turn]) ** 2, axis=0))
    # a standard deviation from 300 samples is known to 1 / sqrt(600) = 4 %; 15 %: nearly four times that, and room for
    # the good points that now and then lose their weight
    assert np.allclose(scatter / expected, 1.0, atol=0.15)
    assert np.sqrt(np.mean([orientation.s0**2 for orientation in found])) == pytest.approx(1.0, abs=0.1)


def test_three_points_have_several_orientations_and_all_are_returned():
    generator = np.random.default_rng(11)
    rotation, centre = rotation_of(2.0, 1.0, 30.0), np.array([0.0, 0.0, 1500.0])
    among = 0
    for _ in range(20):
        points = points_seen(generator, 3, rotation, centre, 150.0, 230.0, (1400.0, 1500.0))
        found = resect(seen(points, rotation, centre, 150.0), points)
        if isinstance(found, Resected):
            centres = np.vstack([found.centre, found.alternatives.centres])
            among += np.linalg.norm(centres - centre, axis=1).min() < 1e-6
            assert found.redundancy == 0
            assert found.s0 == 1.0
            several = [remark for remark in found.remarks if "positions fit three points" in remark]
            assert len(several) == (len(centres) > 1)
    assert among >= 18


def test_a_small_plane_object_far_away_has_a_second_orientation():
    generator = np.random.default_rng(12)
    points = np.column_stack([generator.uniform(-3.0, 3.0, (12, 2)), np.zeros(12)])
    rotation = rotation_of(0.0, 30.0, 0.0)
    centre = rotation @ [0.0, 0.0, 400.0]
    vectors = with_noise(generator, seen(points, rotation, centre, 300.0), 0.02)
    found = resected(vectors, points, error_mm=0.02)
    both = np.vstack([found.centre, found.alternatives.centres])
    assert len(both) == 2
    assert np.linalg.norm(both - centre, axis=1).min() < 20.0
    assert np.linalg.norm(both - centre * [-1.0, 1.0, 1.0], axis=1).min() < 40.0
    assert found.remarks == ("another position of the camera fits the points almost as well",)


def test_equal_input_gives_equal_output():
    generator = np.random.default_rng(13)
    points = points_seen(generator, 25, np.eye(3), np.zeros(3), 50.0, 36.0, (20.0, 40.0))
    vectors = with_noise(generator, seen(points, np.eye(3), np.zeros(3), 50.0), 0.01)
    first, second = resected(vectors, points), resected(vectors, points)
    assert (first.centre == second.centre).all()
    assert (first.rotation == second.rotation).all()


# what cannot be solved


def test_too_few_points():
    assert reason(np.empty((0, 3)), np.empty((0, 3))) == "0 known points in the photo, 3 are needed"
    assert reason(np.ones((1, 3)), np.ones((1, 3))) == "1 known point in the photo, 3 are needed"


def test_points_on_one_line():
    line = np.linspace(0.0, 1.0, 6)[:, None] * [10.0, 5.0, 2.0]
    vectors = np.array([[0.0, 0.0, -50.0], [1.0, 5.0, -50.0], [7.0, 3.0, -50.0]] * 2)
    assert reason(vectors, line) == "the 6 known points lie on one line in space"
    edge_on = np.column_stack([np.linspace(-10.0, 10.0, 6), np.zeros(6), np.full(6, -50.0)])
    points = np.random.default_rng(1).normal(0.0, 1.0, (6, 3))
    assert reason(edge_on, points) == "the 6 known points lie on one line in the photo"


def test_names_interchanged_all_over_the_photo():
    generator = np.random.default_rng(14)
    points = points_seen(generator, 12, np.eye(3), np.zeros(3), 50.0, 36.0, (20.0, 40.0))
    vectors = seen(points, np.eye(3), np.zeros(3), 50.0)
    assert "do not fit their images" in reason(vectors, np.roll(points, 5, axis=0))


def test_dangerous_cylinder():
    """A camera on the cylinder through three points, square to their plane: a small movement changes no image."""
    turns = np.radians([80.0, 200.0, 330.0])
    points = np.column_stack([10.0 * np.cos(turns), 10.0 * np.sin(turns), np.zeros(3)])
    centre = np.array([10.0, 0.0, 30.0])
    assert "do not determine the photo" in reason(seen(points, rotation_of(0.0, 18.0, 0.0), centre, 50.0), points)


def test_points_that_are_all_in_a_corner_of_the_photo_say_nothing():
    generator = np.random.default_rng(15)
    points = np.array([5.0, 5.0, -50.0]) + generator.uniform(-0.05, 0.05, (6, 3))
    vectors = with_noise(generator, seen(points, np.eye(3), np.zeros(3), 50.0), 0.01)
    assert isinstance(resect(vectors, points), Unresected)


def test_orientations_that_see_nothing_cost_as_if_all_points_were_wrong() -> None:
    known = KnownPoints(np.tile([0.0, 0.0, -50.0], (6, 1)), np.zeros((6, 3)), np.zeros(6), 0.01)
    assert _costs(known, np.full((2, 6), np.inf)) == pytest.approx(6 * 3.5**2)
