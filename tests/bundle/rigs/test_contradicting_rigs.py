"""Cameras of a rig against where its photos have them; poses are drawn at random."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from support.rig_blocks import from_nothing, rig_block, without_common_view

from orip.mistakes.rigs.compared_poses import FoundPoses, poses_off, square_sum
from orip.mistakes.rigs.contradicting_rigs import (
    EXCHANGED_CAMERAS,
    MISREAD_MOUNTING,
    MOUNTING,
    NOT_SYNCHRONOUS,
    _compared,
)
from orip.records.rig import Mounting
from orip.solving.solve import solve
from orip.structs import replace

NAMES = dict(enumerate("ABCDE"))
OFFSET_ERROR, TURN_ERROR = 0.002, 1e-4
"""Of a camera as its photos have it, m and radians."""


def _rig(rng):
    rotations = Rotation.random(len(NAMES), rng=rng).as_matrix()
    return {row: (rng.uniform(-0.5, 0.5, 3), rotations[row]) for row in NAMES}


def _moved(pose, shift, turn):
    return pose[0] + shift, Rotation.from_rotvec(turn).as_matrix() @ pose[1]


def _compared_with(said, found):
    covariance = np.diag(np.tile([OFFSET_ERROR**2] * 3 + [TURN_ERROR**2] * 3, len(found)))
    return list(_compared(said, FoundPoses(found, covariance), NAMES, "head", "m"))


def _told(said, found):
    return [(warning.code, warning.where) for warning in _compared_with(said, found)]


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
def test_of_two_exchanged_cameras_the_inverse_mounting_is_named_too(seed):
    pose = _rig(np.random.default_rng(seed))[1]
    found = {0: (np.zeros(3), np.eye(3)), 1: pose}
    inverse = -pose[1].T @ pose[0], pose[1].T
    (warning,) = _compared_with({**found, 1: inverse}, found)
    assert warning.code == EXCHANGED_CAMERAS
    assert "; or camera B of rig head: offsets and rotations lead from the rig to the photo; write" in warning.text


@pytest.mark.parametrize("seed", range(5))
def test_camera_that_is_mounted_elsewhere_is_named_alone(seed):
    said = _rig(np.random.default_rng(seed))
    assert _told(said, {**said, 3: _moved(said[3], np.zeros(3), np.array([0.0, 0.0, 0.01]))}) == [
        (MOUNTING, "camera D")
    ]


def _order_kappa_first(rotation):
    return Rotation.from_euler("XYZ", Rotation.from_matrix(rotation).as_euler("xyz")).as_matrix()


def _as_degrees(rotation):
    angles = Rotation.from_matrix(rotation).as_euler("XYZ", degrees=True)
    return Rotation.from_euler("XYZ", np.radians(angles), degrees=True).as_matrix()


WRITTEN = {
    "a thousand times too large": lambda o, m: (1000.0 * o, m),
    "a thousand times too small": lambda o, m: (o / 1000.0, m),
    "in radians": lambda o, m: (o, _as_degrees(m)),
    "from the rig to the photo; write rotation": lambda o, m: (o, m.T),
    "in the order kappa, phi, omega": lambda o, m: (o, _order_kappa_first(m)),
    "along the axes of the photo": lambda o, m: (m.T @ o, m),
    "lead from the rig to the photo": lambda o, m: (-m.T @ o, m.T),
}


@pytest.mark.parametrize("rows", [(1,), (2, 4), (1, 2, 3, 4)])
@pytest.mark.parametrize("what", WRITTEN)
def test_mountings_that_were_written_otherwise_are_named_with_what_to_write(what, rows):
    """Rotations in radians are told where no angle is beyond the other side of a pole: of these the angles are one."""
    rng = np.random.default_rng(len(what))
    rotations = Rotation.from_euler("XYZ", rng.uniform(-60, 60, (len(NAMES), 3)), degrees=True).as_matrix()
    meant = {row: (rng.uniform(-0.5, 0.5, 3), rotations[row]) for row in NAMES} | {0: (np.zeros(3), np.eye(3))}
    said = meant | {row: WRITTEN[what](*meant[row]) for row in rows}
    (warning,) = _compared_with(said, meant)
    assert (warning.code, warning.where) == (MISREAD_MOUNTING, "rig head")
    assert what in warning.text
    named = [NAMES[row] for row in rows]
    assert warning.text.startswith(f"camera{'s' if len(rows) > 1 else ''} {named[0]}")
    values = warning.text.split("write ")[1]
    key, value = ("offset", meant[rows[0]][0]) if values.startswith("offset") else (
        "rotation", Rotation.from_matrix(meant[rows[0]][1]).as_euler("XYZ", degrees=True))  # fmt: skip
    assert f"{key} = [{', '.join(f'{one:.6g}' for one in value)}]" in values
    assert all(f"for {name}" in values for name in named)


def _with_constant(made, change):
    """Return the block from nothing with constant mountings that a change has been made to."""
    (rig,) = made.block.rigs.rigs
    cameras = [rig.cameras[0]]
    for row in range(1, len(rig.cameras)):
        offset, mounting = change(*_against_first(made, row))
        angles = Rotation.from_matrix(mounting).as_euler("XYZ", degrees=True)
        cameras.append(Mounting(rig.cameras[row].name, tuple(offset.tolist()), None, tuple(angles.tolist())))
    rigs = replace(made.block.rigs, rigs=(replace(rig, cameras=tuple(cameras)),))
    return replace(from_nothing(made.block), rigs=rigs)


def _against_first(made, row):
    to_first = made.mountings[0].T
    return to_first @ (made.offsets[row] - made.offsets[0]), to_first @ made.mountings[row]


@pytest.mark.parametrize("head", ["stereo", "three", "penta"])
@pytest.mark.parametrize(
    "what", ["a thousand times too large", "a thousand times too small", "from the rig to the photo; write rotation"]
)
def test_constant_mountings_written_otherwise_are_named_first_from_nothing(head, what):
    block = _with_constant(rig_block(head, "written", points=80), WRITTEN[what])
    solution, _ = solve(block)
    code, where, text = solution.warnings[0]
    assert (code, where) == (MISREAD_MOUNTING, "rig HEAD")
    assert what in text
    assert {code for code, _, _ in solution.warnings} <= {MISREAD_MOUNTING, "one-ray"}


def test_cameras_without_common_view_are_compared_with_the_rig_that_ties_them():
    made = rig_block("apart", "no common view", points=400)
    apart = replace(made, block=without_common_view(made))
    solution, _ = solve(_with_constant(apart, WRITTEN["a thousand times too large"]))
    assert solution.warnings[0][:2] == (MISREAD_MOUNTING, "rig HEAD")


def _turned(made, degrees):
    """Return the block with constant mountings, the last camera turned."""
    block = _with_constant(made, lambda o, m: (o, m))
    (rig,) = block.rigs.rigs
    last = rig.cameras[-1]
    turn = Rotation.from_rotvec(np.array([0.6, 0.0, 0.8]) * degrees, degrees=True)
    angles = (turn * Rotation.from_euler("XYZ", last.rotation, degrees=True)).as_euler("XYZ", degrees=True)
    cameras = (*rig.cameras[:-1], replace(last, rotation=tuple(angles.tolist())))
    return replace(block, rigs=replace(block.rigs, rigs=(replace(rig, cameras=cameras),)))


@pytest.mark.parametrize("head", ["stereo", "three"])
def test_a_small_turn_that_all_photos_show_together_is_named(head):
    made = rig_block(head, "small", points=150)
    solution, _ = solve(_turned(made, 0.05))
    (found,) = solution.warnings
    assert found[:2] == ("mounting", f"camera {made.block.cameras[-1].name}")
    assert "calibration" not in found[2]


def test_a_principal_point_that_is_wrong_accuses_no_mounting():
    block = _with_constant(rig_block("three", "small", points=150), lambda o, m: (o, m))
    last = block.cameras[-1]
    c, dx, *others = last.parameters
    wrong = replace(last, parameters=(c, dx + 0.03, *others))
    solution, _ = solve(replace(block, cameras=(*block.cameras[:-1], wrong)))
    assert {code for code, _, _ in solution.warnings}.isdisjoint({MOUNTING, MISREAD_MOUNTING, NOT_SYNCHRONOUS})
    assert "the principal point of a camera does not fit" in solution.verdict
    assert [where for code, where, _ in solution.warnings if code == "principal-point"] == [f"camera {last.name}"]


def test_square_sum_of_correlated_poses_is_as_large_as_chance_makes_it():
    """With errors drawn from any covariance it is chi-square distributed on six less than six a camera."""
    rng = np.random.default_rng(5)
    said, count = _rig(rng), 6 * len(NAMES)
    factor = rng.normal(size=(count, count)) * np.tile([OFFSET_ERROR] * 3 + [TURN_ERROR] * 3, len(NAMES))[:, None] / 5.0
    covariance, sums = factor @ factor.T, []
    for _ in range(60):
        errors = (factor @ rng.normal(size=count)).reshape(-1, 6)
        found = {row: _moved(pose, errors[row, :3], errors[row, 3:]) for row, pose in said.items()}
        sums.append(square_sum(said, FoundPoses(found, covariance)))
        assert not poses_off(said, FoundPoses(found, covariance))
    freedom = count - 6.0
    assert abs(np.mean(sums) - freedom) < 4.0 * np.sqrt(2.0 * freedom / len(sums))


@pytest.mark.parametrize("head", ["stereo", "three"])
def test_right_constant_mountings_have_no_warning(head):
    solution, _ = solve(_with_constant(rig_block(head, "written", points=80), lambda o, m: (o, m)))
    assert not solution.warnings


def test_of_an_exposure_that_is_not_synchronous_no_control_is_accused():
    made = rig_block("apart", "d", planted={"exposure": (4, (0.6, 0.0, 0.0), (0.0, 0.0, 0.3))})
    solution, _ = solve(made.block)
    assert [warning[:2] for warning in solution.warnings] == [("not-synchronous", "exposure E5")]
    assert "exposure E5" in solution.verdict
