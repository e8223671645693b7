"""Control that fits a block as a mirror image or in another unit of Z: what is said of it, and when nothing is."""

from __future__ import annotations

import numpy as np
import pytest
from prelim.partial_block_samples import ground_sample, mirrored

from orip.geometry.rotation import rotation_from_angles
from orip.mistakes.ground_systems import misread_control
from orip.prelim.similarity.control_reading import other_reading
from orip.structs import replace
from orip.units import METRES_PER_FOOT

EXCHANGED = np.eye(3)[[1, 0, 2]]


def found_of(sample, matrix=None, block=None, centres=None) -> str:
    """Return what is said of control whose coordinates are multiplied by a matrix."""
    control = sample.control
    if matrix is not None:
        control = replace(control, coordinates=control.coordinates @ np.asarray(matrix).T)
    sentences = misread_control(other_reading(block or sample.block, sample.names, control, centres))
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
        (np.diag([1.0, 1.0, 1.0 / METRES_PER_FOOT]), "when Z is multiplied by 0.3048: Z seems to be in feet"),
        (
            np.diag([1.0 / METRES_PER_FOOT, 1.0 / METRES_PER_FOOT, 1.0]),
            "when Z is multiplied by 3.2808: Z seems to be in metres",
        ),
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
