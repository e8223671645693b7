"""The synthetic blocks are what they say: true at their truth, the same every time, enough to be adjusted."""

from __future__ import annotations

import numpy as np
import pytest
from support.synthetic_block import DISTORTED, synthetic_block

from orip.bundle.problem import pose_problem
from orip.bundle.starting_state import starting_state
from orip.structs import replace

SCENES = ("strip", "convergent", "terrestrial")


@pytest.mark.parametrize("distortion_at", ["ideal", "measured"])
@pytest.mark.parametrize("scene", SCENES)
def test_without_noise_nothing_is_left_at_the_truth(scene, distortion_at):
    made = synthetic_block(scene, "exact", distortion=DISTORTED, distortion_at=distortion_at)
    problem = pose_problem(made.block)
    equations = problem.linearise(starting_state(made.block))
    # 1e-10 mm of an a-priori error of 0.005 mm: rounding of coordinates of some thousand metres
    assert np.abs(equations.residual).max() < 2e-8
    assert equations.active.all()


@pytest.mark.parametrize("scene", SCENES)
def test_every_photo_has_points_and_most_points_have_several_rays(scene):
    points = synthetic_block(scene, "rays").block.photo_points
    assert np.bincount(points.photo).min() >= 8
    assert np.median(np.bincount(points.point)) >= 2


def test_terrestrial_photos_look_exactly_along_x():
    orientations = synthetic_block("terrestrial", "any").orientations
    assert sorted(set(np.degrees(orientations[:, 4]).tolist())) == [-90.0, 90.0]


def test_same_name_same_block_other_name_other_block():
    first, same, other = (synthetic_block("strip", name, noise_mm=0.005).block for name in ("a", "a", "b"))
    assert np.array_equal(first.photo_points.xy, same.photo_points.xy)
    assert not np.array_equal(first.photo_orientation, other.photo_orientation)


def test_noise_and_starting_errors_have_the_size_that_was_asked_for():
    exact = synthetic_block("convergent", "noise")
    noisy = synthetic_block("convergent", "noise", noise_mm=0.01, start_error=0.02)
    difference = noisy.block.photo_points.xy - exact.block.photo_points.xy
    # 600 numbers: their standard deviation is known to 3 %, four times that is allowed
    assert np.std(difference) == pytest.approx(0.01, rel=0.12)
    assert np.array_equal(noisy.points, exact.points)
    assert 0.005 < np.std(noisy.block.photo_orientation[:, 3:] - noisy.orientations[:, 3:]) < 0.05


def test_constants_are_held_and_started_at_the_truth():
    made = synthetic_block("strip", "held", start_error=0.01, control="constant", constant=[("X0", "KAPPA")])
    assert made.block.photos[0].constant == ("X0", "KAPPA")
    assert made.block.photo_orientation[0, [0, 5]].tolist() == made.orientations[0, [0, 5]].tolist()
    assert made.block.constant_points.any(axis=1).sum() == len(made.block.control_points)
    held = made.block.constant_points.all(axis=1)
    assert np.array_equal(made.block.point_start[held], made.points[held])
    assert replace(made.block).control_points == made.block.control_points
