"""Parts of a block that nothing but a rig ties to the ground."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from support.rig_blocks import rig_block, without_common_view

from orip.bundle.rigs.parts import with_parts_on_rigs
from orip.bundle.rigs.starting import robust_poses
from orip.structs import replace


@pytest.mark.parametrize("head", ["apart", "three", "stereo"])
@pytest.mark.parametrize("weighted", [None, (0.01, 0.05)])
def test_photos_in_systems_of_their_own_come_where_the_rig_has_them(head, weighted):
    made = rig_block(head, "parts", points=400, mounting_error=weighted, start_error=0.0)
    block = without_common_view(made)
    truth, moved = block.photo_orientation, block.photo_orientation.copy()
    turn = Rotation.from_euler("XYZ", [0.4, -1.1, 2.0])
    others = np.flatnonzero(block.photo_camera > 0)
    moved[others, :3] = 0.3 * turn.apply(truth[others, :3]) + [500.0, -70.0, 30.0]
    moved[others, 3:] = (turn * Rotation.from_euler("XYZ", truth[others, 3:])).as_euler("XYZ")
    places = made.points[[int(name) - 101 for name in block.point_names]]
    of_others = np.isin(np.arange(len(places)), block.photo_points.point[np.isin(block.photo_points.photo, others)])
    places[of_others] = 0.3 * turn.apply(places[of_others]) + [500.0, -70.0, 30.0]
    found = with_parts_on_rigs(replace(block, photo_orientation=moved), places)
    back = found.block.photo_orientation
    # the errors of given mountings, or what their offsets of some decimetres are drawn to zero where turns are small
    assert np.abs(back[:, :3] - truth[:, :3]).max() < (0.1 if weighted else 0.01)
    turns = Rotation.from_euler("XYZ", back[:, 3:]) * Rotation.from_euler("XYZ", truth[:, 3:]).inv()
    assert turns.magnitude().max() < (0.005 if weighted else 1e-6)
    rays = block.photo_points
    assert set(np.flatnonzero(found.moved)) == set(rays.point[block.photo_camera[rays.photo] > 0])


def test_a_block_that_control_ties_stays():
    made = rig_block("three", "tied", start_error=0.0)
    block = made.block
    found = with_parts_on_rigs(block, made.points)
    assert np.array_equal(found.block.photo_orientation, block.photo_orientation)
    assert not found.moved.any()


def test_photos_of_many_points_tell_where_an_exposure_is():
    turns = Rotation.from_rotvec([[0.0, 0.0, angle] for angle in (0.0, 1.0, 2.0)]).as_matrix()
    places = np.array([[0.0, 0.0, 0.0], [5.0, 5.0, 5.0], [9.0, 9.0, 9.0]])
    group = np.zeros(3, dtype=np.int64)
    centre, rotation = robust_poses(places, turns, group, 1, np.array([25.0, 3.0, 4.0]))
    assert np.abs(centre - places[0]).max() == 0.0
    assert np.abs(rotation[0] - turns[0]).max() < 1e-3
    pair = robust_poses(places[:2], turns[:2], group[:2], 1)[0]
    assert np.abs(pair - 2.5).max() == 0.0
