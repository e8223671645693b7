"""Cameras of a rig against where its photos have them; poses are drawn at random."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from orip.mistakes.contradicting_rigs import EXCHANGED_CAMERAS, MOUNTING, _compared, _Found

NAMES = dict(enumerate("ABCDE"))
OFFSET_ERROR, TURN_ERROR = 0.002, 1e-4
"""Of a camera as its photos have it, m and radians."""


def _rig(rng):
    rotations = Rotation.random(len(NAMES), rng=rng).as_matrix()
    return {row: (rng.uniform(-0.5, 0.5, 3), rotations[row]) for row in NAMES}


def _moved(pose, shift, turn):
    return pose[0] + shift, Rotation.from_rotvec(turn).as_matrix() @ pose[1]


def _told(said, found):
    covariance = np.diag([OFFSET_ERROR**2] * 3 + [TURN_ERROR**2] * 3)
    of_found = _Found(found, dict.fromkeys(NAMES, covariance))
    return [(warning.code, warning.where) for warning in _compared(said, of_found, NAMES, "head", "m")]


@pytest.mark.parametrize("seed", range(5))
def test_rig_that_is_as_it_is_said_to_be_has_no_warning(seed):
    rng = np.random.default_rng(seed)
    said = _rig(rng)
    assert _told(said, {row: _moved(pose, rng.normal(0, OFFSET_ERROR, 3), rng.normal(0, TURN_ERROR, 3))
                        for row, pose in said.items()}) == []  # fmt: skip


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("rest", [0.0, 10.0 * OFFSET_ERROR])
def test_two_cameras_that_are_exchanged_are_named_also_where_one_of_them_is_a_little_off(seed, rest):
    said = _rig(np.random.default_rng(seed))
    found = {**said, 0: said[1], 1: _moved(said[0], np.array([rest, 0.0, 0.0]), np.zeros(3))}
    assert _told(said, found) == [(EXCHANGED_CAMERAS, "rig head")]


@pytest.mark.parametrize("seed", range(5))
def test_camera_that_is_mounted_elsewhere_is_named_alone(seed):
    said = _rig(np.random.default_rng(seed))
    assert _told(said, {**said, 3: _moved(said[3], np.zeros(3), np.array([0.0, 0.0, 0.01]))}) == [
        (MOUNTING, "camera D")
    ]
