"""Absolute orientation: control in full and in part, blunders, too little of it; and control that is a mirror image."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from partial_block_samples import ground_sample, mirrored

from orip.geometry.rotation import rotation_from_angles
from orip.prelim.handedness import handedness
from orip.prelim.similarity.absolute_orientation import KnownPositions, absolute_orientation
from orip.prelim.similarity.joining import Joined
from orip.records.preliminary import NotOriented


def oriented(sample, control=None, centres=None) -> Joined:
    found = absolute_orientation(sample.block, sample.names, control or sample.control, centres)
    assert isinstance(found, Joined), found
    return found


def refused(sample, control=None, centres=None) -> str:
    found = absolute_orientation(sample.block, sample.names, control or sample.control, centres)
    assert isinstance(found, NotOriented), found
    assert (found.name, found.other) == ("AB", "")
    return found.reason


def some(control: KnownPositions, rows) -> KnownPositions:
    names = tuple(np.array(control.names)[rows])
    return KnownPositions(names, control.coordinates[rows], control.errors[rows])


@pytest.mark.parametrize("count", [3, 4, 12])
def test_full_control(count):
    for seed in range(10):
        sample = ground_sample(seed, full=count)
        found = oriented(sample)
        assert sample.turned_by(found.similarity) < (0.05 if count > 3 else 0.5)
        assert found.similarity.scale == pytest.approx(sample.truth.scale, rel=1e-3)
        assert np.allclose(found.block.coordinates - sample.control.coordinates, found.step.residuals, atol=1e-6)
        assert (found.step.step, found.step.source, found.step.target) == ("absolute", "AB", "")
        assert found.step.remarks == ()


def test_exact_control_gives_exact_places():
    sample = ground_sample(1, full=4, noise=0.0)
    found = oriented(sample, replace(sample.control, errors=np.full((4, 3), 0.02)))
    # coordinates of millions are rounded to 1e-9
    assert np.allclose(found.block.coordinates, sample.control.coordinates, atol=1e-7)
    assert np.allclose(found.similarity.rotation, sample.truth.rotation, atol=1e-10)


@pytest.mark.parametrize(("full", "plan", "height"), [(0, 3, 4), (2, 2, 2), (1, 3, 3), (0, 6, 6), (2, 0, 3)])
def test_control_in_part(full, plan, height):
    for seed in range(8):
        sample = ground_sample(seed, full, plan, height)
        found = oriented(sample)
        assert sample.turned_by(found.similarity) < 1.0, seed
        assert np.array_equal(np.isnan(found.step.residuals), np.isnan(sample.control.coordinates))


def test_flat_ground_known_in_part():
    for seed in range(8):
        sample = ground_sample(seed, 0, 3, 3, relief=2.0)
        assert sample.turned_by(oriented(sample).similarity) < 1.0, seed


def test_seven_coordinates_may_fit_in_more_than_one_position():
    told = right = 0
    for seed in range(20):
        sample = ground_sample(seed, 2, 0, 1)
        found = oriented(sample)
        told += any("more than one position" in remark for remark in found.step.remarks)
        right += sample.turned_by(found.similarity) < 1.0
    # the third point may lie on either side of the line through the first two: the photos that look down decide
    assert told >= 18
    assert right >= 19


@pytest.mark.parametrize(
    ("kind", "wrong"), [((5, 0, 0), 1), ((12, 0, 0), 3), ((4, 0, 0), 1), ((0, 6, 6), 1), ((2, 6, 6), 2)]
)
def test_blunders_are_named(kind, wrong):
    for seed in range(5):
        sample = ground_sample(seed, *kind, wrong=wrong)
        found = oriented(sample)
        assert sample.turned_by(found.similarity) < 1.0, seed
        for row in sample.wrong:
            sentences = [text for text in found.step.remarks if f"control point {sample.names.points[row]} " in text]
            assert len(sentences) == 1
        assert len(found.step.remarks) == wrong


def test_one_wrong_coordinate_leaves_the_others_of_its_point():
    sample = ground_sample(3, full=8)
    coordinates = sample.control.coordinates.copy()
    coordinates[2, 2] += 50.0
    found = oriented(sample, replace(sample.control, coordinates=coordinates))
    assert np.array_equal(np.argwhere(found.step.weight_factor < 1.0), [[2, 2]])
    (remark,) = found.step.remarks
    assert remark.startswith("Z of control point C2 does not fit: the block is off by -50")


def test_a_wrong_one_of_three_full_points_shows_by_those_known_in_part():
    right = 0
    for seed in range(10):
        sample = ground_sample(seed, 3, 4, 4)
        coordinates = sample.control.coordinates.copy()
        coordinates[1] += [80.0, -60.0, 40.0]
        found = absolute_orientation(sample.block, sample.names, replace(sample.control, coordinates=coordinates))
        right += isinstance(found, Joined) and sample.turned_by(found.similarity) < 1.0
    assert right >= 9


def test_check_points_are_not_used():
    sample = ground_sample(4, full=6)
    errors, coordinates = sample.control.errors.copy(), sample.control.coordinates.copy()
    errors[5], coordinates[5] = -0.02, coordinates[5] + 100.0
    found = oriented(sample, replace(sample.control, coordinates=coordinates, errors=errors))
    assert "C5" not in found.step.points
    assert found.step.remarks == ()


def test_constant_control_weighs_more_and_all_constant_control_is_legal():
    sample = ground_sample(5, full=5)
    errors = sample.control.errors.copy()
    errors[0] = 0.0
    block = replace(sample.block, deviations=np.zeros_like(sample.block.deviations))
    constant = absolute_orientation(block, sample.names, replace(sample.control, errors=errors))
    plain = absolute_orientation(block, sample.names, sample.control)
    assert isinstance(constant, Joined)
    assert isinstance(plain, Joined)
    assert np.linalg.norm(constant.step.residuals[0]) < 0.3 * np.linalg.norm(plain.step.residuals[0])
    found = absolute_orientation(block, sample.names, replace(sample.control, errors=np.zeros((5, 3))))
    assert isinstance(found, Joined)
    assert sample.turned_by(found.similarity) < 0.05


def test_too_little_control_says_what_is_there():
    sample = ground_sample(6, full=4)
    assert refused(sample, some(sample.control, [0, 1])) == "2 control points in the block, 3 are needed"
    none = KnownPositions((), np.empty((0, 3)), np.empty((0, 3)))
    assert refused(sample, none) == "no control point is in the block, 3 are needed"
    part = some(sample.control, [0, 1, 2])
    part.coordinates[1:, 2] = np.nan
    part.coordinates[2, :2] = np.nan
    part.coordinates[2, 2] = 300.0
    reason = refused(sample, part)
    assert "3 control points in the block with 6 known coordinates (X of 2, Y of 2, Z of 2): 3 points known" in reason


def test_control_on_a_line():
    sample = ground_sample(7, full=5)
    steps = np.linspace(0.0, 1.0, 5)[:, None]
    line = sample.control.coordinates[:1] + steps * [[1200.0, 300.0, 20.0]]
    block = replace(sample.block, coordinates=sample.truth.inverse().apply(line))
    reason = refused(replace(sample, block=block), replace(sample.control, coordinates=line))
    assert "the control points lie on one line" in reason


def test_heights_alone_do_not_suffice():
    sample = ground_sample(8, height=9)
    reason = refused(sample)
    assert "X of 0, Y of 0, Z of 9 points" in reason


def test_projection_centres_help_where_control_does_not_suffice():
    sample = ground_sample(9, full=2)
    assert "2 control points in the block, 3 are needed" in refused(sample)
    found = oriented(sample, centres=sample.centres)
    assert sample.turned_by(found.similarity) < 1.0
    assert found.step.points == ("C0", "C1", "photo A", "photo B", "photo C", "photo D")
    assert found.step.remarks[0].startswith("projection centres are used as control")
    unknown = replace(sample.centres, errors=np.full((4, 3), np.nan))
    assert sample.turned_by(oriented(sample, centres=unknown).similarity) < 1.0


def test_control_of_something_else_is_refused():
    sample = ground_sample(10, full=8)
    other = replace(sample.control, coordinates=np.roll(sample.control.coordinates, 3, axis=0))
    assert "the control does not fit the block" in refused(sample, other)


def test_control_twenty_times_worse_than_promised_is_not_called_wrong():
    down = 0
    for seed in range(20):
        sample = ground_sample(seed, full=10, noise=0.4)
        found = oriented(sample, replace(sample.control, errors=np.full((10, 3), 0.02)))
        down += int((found.step.weight_factor < 1.0).sum())
    assert down <= 6


# mirror images and units

EXCHANGED = np.eye(3)[[1, 0, 2]]


def found_of(sample, matrix=None, block=None, centres=None) -> str:
    control = sample.control
    if matrix is not None:
        control = replace(control, coordinates=control.coordinates @ np.asarray(matrix).T)
    sentences = handedness(block or sample.block, sample.names, control, centres)
    assert len(sentences) <= 1
    return sentences[0] if sentences else ""


@pytest.mark.parametrize("count", [3, 4, 5, 8])
def test_good_control_raises_no_question(count):
    for seed in range(10):
        sample = ground_sample(seed, full=count)
        assert found_of(sample) == ""
        assert found_of(ground_sample(seed, full=count + 2, wrong=1)) == ""


@pytest.mark.parametrize("count", [5, 8])
def test_exchanged_axes_and_mirrored_photos_look_the_same_without_projection_centres(count):
    for seed in range(5):
        sample = ground_sample(seed, full=count)
        exchanged = found_of(sample, EXCHANGED)
        assert "as a mirror image: X and Y of the control are exchanged (north, east" in exchanged
        assert "or the photos are mirrored" in exchanged
        assert "as a mirror image" in found_of(sample, block=mirrored(sample.block))


def test_projection_centres_tell_exchanged_axes_from_mirrored_photos():
    sample = ground_sample(1, full=8)
    exchanged = found_of(sample, EXCHANGED, centres=sample.centres)
    assert "when X and Y are exchanged: the control file probably has north, east in place of" in exchanged
    assert "control fits within 0.0" in exchanged
    mirror = found_of(sample, block=mirrored(sample.block), centres=sample.centres)
    assert "when the photos are mirrored" in mirror
    assert "when X has the opposite sign" in found_of(sample, np.diag([-1.0, 1.0, 1.0]), centres=sample.centres)


def test_heights_that_count_downwards_are_recognised_by_the_side_of_the_cameras():
    for seed in range(5):
        sample = ground_sample(seed, full=8)
        assert "when Z has the opposite sign" in found_of(sample, np.diag([1.0, 1.0, -1.0]))


def test_standing_photos_tell_heights_that_count_downwards():
    sample = ground_sample(2, full=8)
    # the same block seen by horizontal cameras
    upright = sample.truth.rotation.T @ rotation_from_angles(np.array([[np.pi / 2.0, 0.1 * k, 0.0] for k in range(4)]))
    block = replace(sample.block, rotations=upright)
    assert "when Z has the opposite sign" in found_of(sample, np.diag([1.0, 1.0, -1.0]), block)
    assert "as a mirror image" in found_of(sample, EXCHANGED, block)


@pytest.mark.parametrize(
    ("matrix", "says"),
    [
        (np.diag([1.0, 1.0, 1.0 / 0.3048]), "when Z is multiplied by 0.3048: Z seems to be in feet"),
        (np.diag([1.0 / 0.3048, 1.0 / 0.3048, 1.0]), "when Z is multiplied by 3.2808: Z seems to be in metres"),
        (np.diag([1.0, 1.0, 1000.0]), "when Z is multiplied by 0.001"),
    ],
)
def test_heights_in_another_unit(matrix, says):
    for seed in range(5):
        assert says in found_of(ground_sample(seed, full=6), matrix)


def test_three_points_always_fit_a_mirror_image_but_not_from_below():
    sample = ground_sample(3, full=3)
    sentence = found_of(sample, EXCHANGED)
    assert sentence.startswith("three control points fit within")
    assert "with the cameras below them, looking up" in sentence
    assert "or measure control points at other heights" in sentence


def test_points_in_a_plane_seen_from_below():
    sample = ground_sample(4, full=8, relief=0.0)
    assert "control points that lie in a plane fit" in found_of(sample, EXCHANGED)


def test_two_points_say_nothing():
    sample = ground_sample(5, full=2)
    assert found_of(sample, EXCHANGED) == ""


@pytest.mark.long
@pytest.mark.parametrize(("full", "plan", "height"), [(0, 3, 4), (2, 2, 2), (0, 6, 6)])
def test_control_in_part_never_fails(full, plan, height):
    right = sum(
        sample.turned_by(oriented(sample).similarity) < 2.0
        for sample in (ground_sample(seed, full, plan, height) for seed in range(1000))
    )
    assert right >= 998
