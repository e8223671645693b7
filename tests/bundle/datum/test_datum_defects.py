"""Unknowns that nothing determines are found, named, and taken out; the rest is solved."""

from __future__ import annotations

import numpy as np
import pytest
from bundle.aerial_block import aerial_block
from bundle.solving import controlled, noisy, redefined, singular, solution, started_off, with_photo_points, with_photos
from support.synthetic_block import synthetic_block

from orip.structs import replace


def aerial(name):
    return aerial_block(name, 7)


def one_wall(name):
    """Return the photos of one wall: those of the other show none of its points."""
    return with_photos(synthetic_block("terrestrial", name), 3)


def around_an_object(name):
    return synthetic_block("convergent", name)


SCENES = {"aerial": aerial, "one wall": one_wall, "around an object": around_an_object}


def measured(scene, name):
    made = SCENES[scene](name)
    return made, started_off(made, noisy(made, 1), 2)


def without_control(scene, name, shift=0.0):
    block = replace(measured(scene, name)[1], control_points=())
    offset = np.array([shift, shift, 0.0, 0.0, 0.0, 0.0])
    return replace(
        block, photo_orientation=block.photo_orientation + offset, point_start=block.point_start + offset[:3]
    )


@pytest.mark.parametrize("shift", [0.0, 5e5, 6e6])
@pytest.mark.parametrize("name", ["a", "b", "c"])
@pytest.mark.parametrize("scene", SCENES)
def test_without_control_seven_unknowns_of_photos_are_singular(scene, name, shift):
    block = without_control(scene, name, shift)
    found = solution(block)
    assert found.status == "converged"
    assert len(found.singular) == 7
    assert {unknown.group for unknown in found.singular} == {"PHOTO"}
    assert [iteration.singular for iteration in found.iterations] == [7] * len(found.iterations)
    assert found.redundancy == found.observations - found.unknowns + 7
    # the residuals do not depend on the ground system
    assert found.sigma0 == pytest.approx(solution(redefined(block, datum="free")).sigma0, rel=1e-4)


def test_standard_deviation_of_what_is_singular_is_infinite_and_its_value_stays():
    block = without_control("aerial", "a")
    found = solution(block)
    photos, elements = found.photos.names, ("X0", "Y0", "Z0", "OMEGA", "PHI", "KAPPA")
    for name, kind in singular(found):
        assert found.photos.sd[photos.index(name), elements.index(kind)] == np.inf
    assert np.isinf(found.photos.sd).sum() == 7
    held = [elements.index(kind) for name, kind in singular(found) if name == "P15" and kind in elements[:3]]
    assert held
    assert np.array_equal(found.photos.values[-1, held], block.photo_orientation[-1, held])
    assert np.isfinite(found.photos.sd[0]).all()


def test_two_blocks_that_share_no_point_have_fourteen_singular_unknowns_without_control():
    made = synthetic_block("terrestrial", "walls")
    found = solution(replace(started_off(made, noisy(made, 1), 2), control_points=()))
    assert found.status == "converged"
    assert len(found.singular) == 14
    assert {unknown.name for unknown in found.singular} <= {"P2", "P3", "P5", "P6"}


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
    made, block = measured("aerial", name)
    found = solution(controlled(made, block, two_points(made, axis), error))
    assert found.status == "converged"
    assert singular(found) == [("P15", kind)]
    assert any(
        diagnosis.code == "undetermined" and "P15" in diagnosis.text and kind in diagnosis.text
        for diagnosis in found.diagnosis
    )


def test_three_control_points_determine_everything():
    made, block = measured("aerial", "a")
    names = [block.point_names[place] for place in (0, 3, len(made.points) - 1)]
    assert solution(controlled(made, block, names)).singular == ()


@pytest.mark.parametrize("scene", SCENES)
def test_one_ray_leaves_one_coordinate_of_its_point(scene):
    _, block = measured(scene, "ray")
    tie = next(
        place
        for place, name in enumerate(block.point_names)
        if name not in {point.name for point in block.control_points}
    )
    mine = np.flatnonzero(block.photo_points.point == tie)
    keep = np.ones(len(block.photo_points.point), dtype=bool)
    keep[mine[1:]] = False
    found = solution(with_photo_points(block, keep))
    assert found.status == "converged"
    assert [unknown.name for unknown in found.singular] == [block.point_names[tie]]
    assert found.point_rays[tie] == 1
    if scene == "aerial":
        # the coordinate along which the ray runs
        assert found.singular[0].kind == "Z"
    # the others follow from it along the ray
    assert np.isinf(found.points.sd[tie]).all()
    assert any(diagnosis.code == "undetermined" and "one ray" in diagnosis.text for diagnosis in found.diagnosis)


def test_a_point_without_any_ray_is_named_with_its_three_coordinates():
    _, block = measured("aerial", "ray")
    points = block.photo_points
    used = points.used & (points.point != 1)[:, None]
    found = solution(replace(block, photo_points=replace(points, used=used)))
    name = block.point_names[1]
    assert singular(found) == [(name, "X"), (name, "Y"), (name, "Z")]


def test_a_point_of_one_ray_with_control_of_its_height_is_determined():
    made, block = measured("aerial", "ray")
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
