"""The block in plan: the plane that suits it, and outlines of models against frames that are known."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from support.drive_tables import loaded, vertical_block

from orip.multimodel.plan_view import BlockPoints, plan_view
from orip.structs import replace

GROUND = np.array([(x, y, 0.0) for x in range(-20, 101, 5) for y in range(-80, 41, 5)], dtype=float)


def points(xyz):
    return BlockPoints(tuple(map(str, range(len(xyz)))), ("tie",) * len(xyz), np.asarray(xyz, dtype=float))


def turned(table, matrix):
    """Return the table with the whole block turned about the origin."""
    photos = tuple(
        replace(
            photo,
            centre=tuple((matrix @ photo.centre).tolist()),
            rotation=tuple((matrix @ np.reshape(photo.rotation, (3, 3))).ravel().tolist()),
        )
        for photo in table.photos
    )
    return replace(table, photos=photos, start=tuple((matrix @ table.start).tolist()))


def area(polygon):
    x, y = polygon.T
    return 0.5 * abs(np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1)))


def test_outlines_are_the_frames():
    """Frames of 20 mm by 24 mm at 1:2000 with a base of 20 m: what two photos show is 20 m by 48 m, side by side."""
    block, _ = loaded(vertical_block())
    view = plan_view(block, points(GROUND))
    assert view.plane[:] == (0, 1, 2, False)
    for model, outline in zip(block.models, view.outlines, strict=True):
        left, top = 20.0 * (model.column - 1), 24.0 - 48.0 * (model.row - 1)
        # the outline is bisected: a millionth of the extent of the block
        assert outline.max(axis=0) == pytest.approx([left + 20.0, top], abs=2e-4)
        assert outline.min(axis=0) == pytest.approx([left, top - 48.0], abs=2e-4)
        # between rays two degrees apart only corners are cut off: up to 0.5 m² each of this rectangle
        assert 960.0 - 2.0 < area(outline) <= 960.0 + 1e-3


@pytest.mark.parametrize(
    ("angles", "plane"),
    [
        ((90.0, 0.0, 0.0), (0, 2, 1, False)),  # cameras look to +Y
        ((90.0, 0.0, 180.0), (0, 2, 1, True)),  # to -Y: X runs to the left
        ((90.0, 0.0, -90.0), (1, 2, 0, True)),  # to +X
        ((90.0, 0.0, 90.0), (1, 2, 0, False)),  # to -X
        ((90.0, 0.0, 20.0), (0, 2, 1, False)),  # a cliff that runs at an angle
        ((180.0, 0.0, 0.0), (0, 1, 2, False)),  # upwards, at a ceiling: a map all the same
    ],
)
def test_the_plane_is_that_of_the_largest_spread(angles, plane):
    matrix = Rotation.from_euler("xyz", angles, degrees=True).as_matrix()
    block, _ = loaded(turned(vertical_block(), matrix))
    xyz = GROUND @ matrix.T
    view = plan_view(block, points(xyz))
    assert view.plane[:] == plane
    assert view.object_places(xyz[:, [view.plane.right, view.plane.up]]) == pytest.approx(xyz, abs=1e-9)
    # seen from the cameras, what is to the right in the photo is to the right in the plan
    to_right = matrix @ np.array([1.0, 0.0, 0.0])
    if plane[1] == 2:
        assert to_right[view.plane.right] * (-1.0 if view.plane.mirrored else 1.0) > 0.0
        # the area is seen at an angle, the sides stay: 960 m² times the cosine
        shown = np.abs(matrix[:, 2])[view.plane.third]
        assert area(view.outlines[0]) == pytest.approx(960.0 * shown, abs=2.5)


def test_between_points_the_third_coordinate_is_between_theirs():
    block, _ = loaded(vertical_block())
    random = np.random.default_rng(3)
    xyz = np.column_stack(
        [random.uniform(-20.0, 100.0, 300), random.uniform(-80.0, 40.0, 300), random.normal(size=300)]
    )
    view = plan_view(block, points(xyz))
    plan = random.uniform(-200.0, 200.0, (500, 2))
    found = view.object_places(plan)
    assert found[:, :2] == pytest.approx(plan, abs=0.0)
    for place in found:
        nearest = xyz[np.argsort(np.hypot(*(xyz[:, :2] - place[:2]).T))[:6], 2]
        assert nearest.min() <= place[2] <= nearest.max()
    assert view.object_place(*xyz[7, :2]) == pytest.approx(xyz[7], abs=1e-9)


def test_points_without_a_place_are_left_out_and_none_are_enough():
    block, _ = loaded(vertical_block())
    xyz = GROUND.copy()
    xyz[3, 2] = np.nan
    view = plan_view(block, points(xyz))
    assert "3" not in view.points.names
    assert len(view.points.names) == len(GROUND) - 1
    empty = plan_view(block, points(np.empty((0, 3))))
    assert [len(outline) for outline in empty.outlines] == [0] * len(block.models)
    assert empty.object_place(12.0, -7.0) == (12.0, -7.0, 0.0)  # at the height of START
