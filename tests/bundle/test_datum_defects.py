"""Unknowns that nothing determines are found, named, and taken out; the rest is solved."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from bundle.aerial_block import aerial_block
from bundle.solving import controlled, redefined, singular, solution, with_photo_points, with_rays
from support.synthetic_block import synthetic_block

SCENES = ("strip", "terrestrial", "convergent")


def made_without_control(scene, name, shift=0.0):
    made = with_rays(synthetic_block(scene, name, noise_mm=0.005, start_error=0.002), 2)
    block = replace(made.block, control_points=())
    moved = block.photo_orientation + [shift, shift, 0.0, 0.0, 0.0, 0.0]
    return replace(block, photo_orientation=moved, point_start=block.point_start + [shift, shift, 0.0])


@pytest.mark.parametrize("shift", [0.0, 5e5, 6e6])
@pytest.mark.parametrize("name", ["a", "b", "c"])
@pytest.mark.parametrize("scene", SCENES)
def test_without_control_seven_unknowns_of_photos_are_singular(scene, name, shift):
    block = made_without_control(scene, name, shift)
    found = solution(block)
    assert found.status == "converged"
    assert len(found.singular) == 7
    assert {each.group for each in found.singular} == {"PHOTO"}
    assert [each.singular for each in found.iterations] == [7] * len(found.iterations)
    assert found.redundancy == found.observations - found.unknowns + 7
    # the residuals do not depend on the ground system
    assert found.sigma0 == pytest.approx(solution(redefined(block, datum="free")).sigma0, rel=1e-4)


def test_standard_deviation_of_what_is_singular_is_infinite_and_its_value_stays():
    block = made_without_control("strip", "a")
    found = solution(block)
    photos, elements = found.photos.names, ("X0", "Y0", "Z0", "OMEGA", "PHI", "KAPPA")
    for name, kind in singular(found):
        assert found.photos.sd[photos.index(name), elements.index(kind)] == np.inf
    last = block.photo_orientation[-1, :3]
    held = [elements.index(kind) for name, kind in singular(found) if name == "P6" and kind in elements[:3]]
    assert np.array_equal(found.photos.values[-1, held], last[held])
    assert np.isfinite(found.photos.sd[0]).all()


def test_aerial_block_without_control_in_coordinates_of_millions():
    block = aerial_block("datum").block
    shift = np.array([4.4e6, 5.7e6, 0.0])
    block = replace(
        block,
        control_points=(),
        point_start=block.point_start + shift,
        photo_orientation=block.photo_orientation + np.r_[shift, 0.0, 0.0, 0.0],
    )
    found = solution(block)
    assert found.status == "converged"
    assert len(found.singular) == 7
    assert min(each.lost_digits for each in found.singular) > 13.0


def two_points(made, axis):
    """Return the two points farthest apart among those that differ along one axis alone."""
    xyz = made.points
    pairs = [
        (abs(xyz[b, axis] - xyz[a, axis]), a, b)
        for a in range(len(xyz))
        for b in range(a)
        if abs(xyz[b, 1 - axis] - xyz[a, 1 - axis]) < 1e-6
    ]
    _, a, b = max(pairs)
    return [made.block.point_names[a], made.block.point_names[b]]


@pytest.mark.parametrize("error", [0.0, 0.02])
@pytest.mark.parametrize(("axis", "kind"), [(0, "OMEGA"), (1, "PHI")])
@pytest.mark.parametrize("name", ["a", "b"])
def test_two_control_points_leave_the_rotation_about_the_line_between_them(name, axis, kind, error):
    made = with_rays(synthetic_block("strip", name, noise_mm=0.005, start_error=0.002), 2)
    # both at the same height: then the line is along the axis
    found = solution(controlled(made, made.block, two_points(made, axis), error))
    assert found.status == "converged"
    assert singular(found) == [("P6", kind)]
    assert any(each.code == "undetermined" and "P6" in each.text and kind in each.text for each in found.diagnosis)


def test_three_control_points_determine_everything():
    made = with_rays(synthetic_block("strip", "a", noise_mm=0.005, start_error=0.002), 2)
    names = [made.block.point_names[place] for place in (0, len(made.points) - 1, len(made.points) // 2)]
    assert solution(controlled(made, made.block, names)).singular == ()


@pytest.mark.parametrize("scene", SCENES)
def test_one_ray_leaves_one_coordinate_of_its_point(scene):
    made = with_rays(synthetic_block(scene, "ray", noise_mm=0.005), 2)
    block = made.block
    tie = next(
        place for place, name in enumerate(block.point_names) if name not in {each.name for each in block.control_points}
    )
    mine = np.flatnonzero(block.photo_points.point == tie)
    keep = np.ones(len(block.photo_points.point), dtype=bool)
    keep[mine[1:]] = False
    found = solution(with_photo_points(block, keep))
    assert found.status == "converged"
    assert [each.name for each in found.singular] == [block.point_names[tie]]
    assert found.point_rays[tie] == 1
    # named is the coordinate along which the ray runs: Z of vertical photos, X of those along X
    if scene != "convergent":
        assert found.singular[0].kind == {"strip": "Z", "terrestrial": "X"}[scene]
    assert np.isinf(found.points.sd[tie]).sum() == 1
    assert any(each.code == "undetermined" and "one ray" in each.text for each in found.diagnosis)


def test_a_point_without_any_ray_is_named_with_its_three_coordinates():
    made = with_rays(synthetic_block("strip", "ray", noise_mm=0.005), 2)
    tie = made.block.point_index()["102"] if "102" in made.block.point_names else 1
    points = made.block.photo_points
    used = points.used & (points.point != tie)[:, None]
    found = solution(replace(made.block, photo_points=replace(points, used=used)))
    name = made.block.point_names[tie]
    assert singular(found) == [(name, "X"), (name, "Y"), (name, "Z")]


def test_a_point_of_one_ray_with_control_of_its_height_is_determined():
    made = with_rays(synthetic_block("strip", "ray", noise_mm=0.005), 2)
    block = made.block
    mine = np.flatnonzero(block.photo_points.point == 1)
    keep = np.ones(len(block.photo_points.point), dtype=bool)
    keep[mine[1:]] = False
    block = with_photo_points(block, keep)
    height = replace(
        block.control_points[0],
        name=block.point_names[1],
        coordinates=(None, None, float(made.points[1, 2])),
        errors=(None, None, 0.05),
    )
    found = solution(replace(block, control_points=(*block.control_points, height)))
    assert found.singular == ()
    assert np.abs(found.points.values[1] - made.points[1]).max() < 0.5
