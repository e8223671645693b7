"""The ground system is arbitrary: shifting and turning it changes results only as it must."""

from __future__ import annotations

import numpy as np
import pytest
from bundle.aerial_block import aerial_block
from bundle.solving import OFF, noisy, redefined, solution, started_off
from scipy.spatial.transform import Rotation
from support.synthetic_block import synthetic_block

from orip.structs import replace

MADE = {
    "aerial": aerial_block("anywhere", 6),
    "around an object": synthetic_block("convergent", "anywhere", unknown=("C", "DX", "DY", "A3")),
    "phi = ±90": synthetic_block("terrestrial", "anywhere"),
}
TURNS = {
    "not at all": np.eye(3),
    "about Z": Rotation.from_euler("Z", 137.0, degrees=True).as_matrix(),
    "upside down": Rotation.from_euler("X", 180.0, degrees=True).as_matrix(),
    "onto its side": Rotation.from_euler("XYZ", [20.0, 90.0, -45.0], degrees=True).as_matrix(),
}


def measured(scene):
    made = MADE[scene]
    return redefined(started_off(made, noisy(made, 1), 2, 0.001), **OFF)


def moved(block, shift, turn):
    """Return the block in another ground system. Errors of control are the same in all directions."""
    rotations = turn @ Rotation.from_euler("XYZ", block.photo_orientation[:, 3:]).as_matrix()
    # at phi = ±90 scipy warns of what docs/conventions.md says: kappa is arbitrary
    angles = np.array([angles_of(rotation) for rotation in rotations])
    return replace(
        block,
        photo_orientation=np.hstack([block.photo_orientation[:, :3] @ turn.T + shift, angles]),
        point_start=block.point_start @ turn.T + shift,
        control_points=tuple(
            replace(point, coordinates=tuple((turn @ np.array(point.coordinates) + shift).tolist()))
            for point in block.control_points
        ),
    )


def angles_of(rotation):
    """Return omega, phi, kappa; from docs/conventions.md."""
    phi = np.arctan2(rotation[0, 2], np.hypot(rotation[0, 0], rotation[0, 1]))
    if np.cos(phi) < 1e-9:
        return [np.arctan2(rotation[2, 1], rotation[1, 1]), phi, 0.0]
    return [np.arctan2(-rotation[1, 2], rotation[2, 2]), phi, np.arctan2(-rotation[0, 1], rotation[0, 0])]


@pytest.mark.parametrize("shift", [0.0, 1e6])
@pytest.mark.parametrize("turn", TURNS)
@pytest.mark.parametrize("scene", MADE)
def test_moving_the_ground_system_moves_the_points_and_nothing_else(scene, turn, shift):
    block, matrix = measured(scene), TURNS[turn]
    offset = shift * np.array([1.0, -2.0, 0.5])
    here, there = solution(block), solution(moved(block, offset, matrix))
    # coordinates of millions have ten digits behind the point left, in micrometres of a photo some 1e-4
    small = 1e-6 if shift else 1e-8
    size = np.abs(here.points.values - here.points.values.mean(axis=0)).max()
    assert there.status == here.status == "converged"
    assert there.sigma0 == pytest.approx(here.sigma0, rel=small)
    assert np.allclose(there.points.values, here.points.values @ matrix.T + offset, rtol=0.0, atol=1e3 * small * size)
    assert np.allclose(there.cameras.values, here.cameras.values, rtol=1e-5, atol=1e-9)
    photo = np.array(here.residuals.kind) == "photo"
    assert np.allclose(there.residuals.residual[photo], here.residuals.residual[photo], atol=1e-6)
    assert np.allclose(there.residuals.redundancy_number[photo], here.residuals.redundancy_number[photo], atol=1e-5)
    assert there.redundancy == here.redundancy
    # how good a point is in space does not depend on the axes
    assert np.allclose(np.sum(there.points.sd**2, axis=1), np.sum(here.points.sd**2, axis=1), rtol=1e-4)


@pytest.mark.parametrize("scene", MADE)
def test_a_shift_alone_leaves_all_standard_deviations(scene):
    block = measured(scene)
    here, there = solution(block), solution(moved(block, np.array([1e6, 1e6, 0.0]), np.eye(3)))
    assert np.allclose(there.points.sd, here.points.sd, rtol=1e-4)
    assert np.allclose(there.photos.sd[:, :3], here.photos.sd[:, :3], rtol=1e-4)
    assert np.allclose(there.photos.values[:, :3] - 1e6 * np.array([1, 1, 0]), here.photos.values[:, :3], atol=1e-3)


def test_the_unit_of_the_ground_does_not_matter():
    block = measured("aerial")
    feet = 3.280839895
    scaled = replace(
        block,
        photo_orientation=block.photo_orientation * np.repeat([feet, 1.0], 3),
        point_start=block.point_start * feet,
        control_points=tuple(
            replace(
                point,
                coordinates=tuple(value * feet for value in point.coordinates),
                errors=tuple(error * feet for error in point.errors),
            )
            for point in block.control_points
        ),
    )
    here, there = solution(block), solution(scaled)
    assert there.sigma0 == pytest.approx(here.sigma0, rel=1e-8)
    assert np.allclose(there.points.values, feet * here.points.values, rtol=1e-8)
    assert np.allclose(there.points.sd, feet * here.points.sd, rtol=1e-6)
    assert np.allclose(there.residuals.w, here.residuals.w, atol=1e-5, equal_nan=True)


def test_the_order_of_photos_and_points_does_not_matter():
    block = measured("aerial")
    random = np.random.default_rng(9)
    photos, points = random.permutation(len(block.photos)), random.permutation(len(block.point_names))
    new_photo, new_point = np.argsort(photos), np.argsort(points)
    mixed = replace(
        block,
        photos=tuple(block.photos[place] for place in photos),
        photo_camera=block.photo_camera[photos],
        photo_orientation=block.photo_orientation[photos],
        point_names=tuple(block.point_names[place] for place in points),
        point_start=block.point_start[points],
        constant_points=block.constant_points[points],
        photo_points=replace(
            block.photo_points,
            photo=new_photo[block.photo_points.photo],
            point=new_point[block.photo_points.point],
        ),
        control_points=block.control_points[::-1],
    )
    here, there = solution(block), solution(mixed)
    assert there.sigma0 == pytest.approx(here.sigma0, rel=1e-9)
    assert np.allclose(there.points.values[new_point], here.points.values, atol=1e-6)
    assert np.allclose(there.photos.sd[new_photo], here.photos.sd, rtol=1e-6)
