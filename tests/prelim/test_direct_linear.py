"""Direct linear transformation against cameras and orientations that are known, and its critical cases."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from orip.prelim.resection.resection import Unresected
from orip.prelim.unknown_cameras import DirectLinear, direct_linear

C, POINT = 35.0, np.array([0.4, -0.7])
CENTRE = np.array([5012.0, 3007.0, 140.0])
ROTATION = Rotation.from_euler("XYZ", [70.0, 25.0, -110.0], degrees=True).as_matrix()


def points_in_front(count: int, thickness: float = 1.0) -> np.ndarray:
    """Return points 20 to 40 m in front of the camera, or as near to a plane as wanted."""
    random = np.random.default_rng(count)
    in_photo = random.uniform([-12.0, -8.0, -40.0], [12.0, 8.0, -20.0], (count, 3))
    in_photo[:, 2] = -30.0 + thickness * (in_photo[:, 2] + 30.0)
    return CENTRE + in_photo @ ROTATION.T


def images(points: np.ndarray) -> np.ndarray:
    u = (points - CENTRE) @ ROTATION
    return POINT - C * u[:, :2] / u[:, 2:]


@pytest.mark.parametrize("count", [6, 7, 20])
def test_camera_and_orientation_are_those_that_took_the_photo(count: int) -> None:
    points = points_in_front(count)
    found = direct_linear(images(points), points)
    assert isinstance(found, DirectLinear)
    # linear equations of condition 1e4 at the most, coordinates of 5000 m
    assert found.principal_distance == pytest.approx(C, rel=1e-8)
    np.testing.assert_allclose(found.principal_point, POINT, atol=1e-7)
    np.testing.assert_allclose(found.rotation, ROTATION, atol=1e-8)
    np.testing.assert_allclose(found.centre, CENTRE, atol=1e-6)
    assert np.linalg.det(found.rotation) == pytest.approx(1.0)


def test_errors_of_measurement_change_it_in_proportion() -> None:
    points = points_in_front(40)
    noise = np.random.default_rng(0).normal(size=(40, 2))
    off = []
    for size in (1e-4, 1e-3):
        found = direct_linear(images(points) + size * noise, points)
        assert isinstance(found, DirectLinear)
        off.append(found.principal_distance - C)
    assert off[1] == pytest.approx(10.0 * off[0], rel=0.05)
    # 1 µm in 40 photo points of 17 mm extent
    assert abs(off[1]) < 0.05


@pytest.mark.parametrize(
    ("points", "reason"),
    [
        (points_in_front(5), "5 known points in the photo, a direct linear transformation needs 6"),
        (points_in_front(12, 0.0), "the 12 known points lie nearly in one plane"),
        (points_in_front(12, 0.01), "the 12 known points lie nearly in one plane"),
    ],
    ids=["five points", "a plane", "nearly a plane"],
)
def test_points_that_do_not_determine_a_camera_are_told(points: np.ndarray, reason: str) -> None:
    found = direct_linear(images(points), points)
    assert isinstance(found, Unresected)
    assert found.reason.startswith(reason)


def test_points_on_a_twisted_cubic_through_the_centre_are_told() -> None:
    t = np.array([-3.0, -2.0, -1.2, 0.8, 1.5, 2.5, 3.5, 4.0])
    cubic = np.column_stack([t, t**2 / 3.0, t**3 / 10.0])
    # the centre is that of t = 0, and the photo looks along the sum of the directions to the points
    towards = (cubic / np.linalg.norm(cubic, axis=1)[:, None]).mean(axis=0)
    back = -towards / np.linalg.norm(towards)
    right = np.cross([0.3, 1.0, 0.2], back)
    rotation = np.column_stack([right / np.linalg.norm(right), np.cross(back, right / np.linalg.norm(right)), back])
    u = cubic @ rotation
    found = direct_linear(-C * u[:, :2] / u[:, 2:], cubic)
    assert isinstance(found, Unresected)
    assert "on a curve" in found.reason


def test_a_mirrored_photo_has_no_camera() -> None:
    points = points_in_front(10)
    found = direct_linear(images(points) * [-1.0, 1.0], points)
    assert isinstance(found, Unresected)
    assert "behind" in found.reason
