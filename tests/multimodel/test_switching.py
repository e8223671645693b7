"""Automatic model switching: exactly at frame lines, and the same for one point as for many."""

from __future__ import annotations

import numpy as np
import pytest
from support.drive_tables import BASE, PLAIN_CAMERA, WIDTH, cameras, loaded, vertical_block

from orip.multimodel.movement import automatic, drive_object, lock
from orip.multimodel.readout import drive_objects, object_position
from orip.multimodel.state import select_model, select_models
from orip.records.drive_table import DriveCode
from orip.structs import replace

CAMERAS = cameras()


def line(start, end, count):
    return np.linspace(start, end, count)


@pytest.mark.parametrize("y", [0.0, -WIDTH], ids=["strip 1", "strip 2"])
def test_walking_along_a_strip_visits_each_model_once(y):
    """Without distortion and on flat ground model k of a strip reaches from k to k + 1 bases."""
    block, state = loaded(vertical_block())
    points = line((0.01, y, 0.0), (4 * BASE - 0.01, y, 0.0), 4001)
    _, driven = drive_objects(block, state, points)
    assert driven.inside.all()
    assert not driven.code.any()
    names = [block.models[model].name for model in driven.model]
    strip = 1 if y == 0.0 else 2
    assert list(dict.fromkeys(names)) == [f"M{strip}-{column}" for column in range(1, 5)]
    changes = np.flatnonzero(np.diff(driven.model))
    assert len(changes) == 3
    for number, change in enumerate(changes, start=1):
        # the line itself belongs to both; a hair of rounding on it may belong to either
        assert points[change, 0] <= number * BASE + 1e-9 < points[change + 1, 0] + 2e-9


@pytest.mark.parametrize("name", CAMERAS)
def test_the_ground_coordinate_is_continuous(name):
    block, state = loaded(vertical_block(camera=CAMERAS[name], tilted=True))
    points = line((5.0, 2.0, -3.0), (75.0, -3.0, 4.0), 500)
    _, driven = drive_objects(block, state, points)
    assert len(np.unique(driven.model)) == 4
    for model in np.unique(driven.model):
        mine = driven.model == model
        back = block.models[model].object_places(driven.upper[mine], driven.lower[mine])
        # metres; Newton's method leaves 1e-12 mm in the photo
        assert np.abs(back.xyz - points[mine]).max() < 1e-9


def test_the_active_model_is_kept_while_the_mark_is_inside():
    """On higher ground models overlap less, on lower ground more: there the line is crossed late in both directions."""
    block, state = loaded(vertical_block(rows=1, columns=2))
    ground = -25.0  # frames are 50 m wide to each side of a centre that is 20 m from the next
    there = line((10.0, 0.0, ground), (30.0, 0.0, ground), 2001)
    state, forth = drive_objects(block, state, there)
    _, back = drive_objects(block, state, there[::-1])
    # model 1 ends at 25 m, where photo 1 ends; model 2 begins at 15 m
    assert there[np.argmax(forth.model == 1), 0] == pytest.approx(25.0, abs=0.011)
    assert there[::-1][np.argmax(back.model == 0), 0] == pytest.approx(15.0, abs=0.011)


def test_of_several_models_the_nearest_by_row_and_column_is_taken():
    block, _ = loaded(vertical_block(rows=1, columns=4))
    # 200 m below the cameras frames are twice as wide as on the ground of the others
    point = (50.0, 0.0, -100.0)
    inside = [
        place for place, model in enumerate(block.models) if all(p.plate_place(*point).inside for p in model.photos)
    ]
    assert inside == [1, 2, 3]
    assert select_model(block, 0, point).model == 1
    assert select_model(block, 3, point).model == 3


def strips_at(*ys):
    """Return a block of strips of one model each, at these Y."""
    table = vertical_block(rows=len(ys), columns=1)
    photos = (
        replace(photo, centre=(photo.centre[0], ys[int(photo.name[1]) - 1], photo.centre[2])) for photo in table.photos
    )
    return loaded(replace(table, photos=tuple(photos)))


@pytest.mark.parametrize(("y", "expected"), [(14.0, "M3-1"), (-8.0, "M1-1")])
def test_of_equally_near_models_the_one_farther_from_its_frame_lines_is_taken(y, expected):
    """Strip 2 is far away; its neighbours overlap. In the nearer one the point is at half the frame, in x."""
    block, _ = strips_at(0.0, 500.0, 6.0)
    point = (10.0, y, 0.0)
    ratios = {model.name: max(photo.plate_place(*point).ratio for photo in model.photos) for model in block.models}
    assert ratios[expected] == pytest.approx(0.5, abs=1e-12)
    assert sorted(ratios.values())[:2] == pytest.approx([0.5, 7.0 / 12.0], abs=1e-12)
    assert block.models[select_model(block, 1, point).model].name == expected
    assert block.models[select_models(block, 1, np.array([point])).model[0]].name == expected


def test_equals_are_taken_by_row():
    block, _ = strips_at(0.0, 500.0, 0.0)
    # model 2-1 is active and 500 m away; 1-1 and 3-1 are equal in all but the row
    assert select_model(block, 1, (10.0, 0.0, 0.0)).model == 0
    assert select_models(block, 1, np.array([[10.0, 0.0, 0.0]])).model.tolist() == [0]


def test_outside_all_models_the_active_one_stays():
    block, state = loaded(vertical_block())
    state, reply = drive_object(block, state, (30.0, 0.0, 0.0))
    assert reply.model == "M1-2"
    state, reply = drive_object(block, state, (30.0, 26.0, 0.0))
    assert (reply.model, state.condition) == ("M1-2", "OUTSIDE")
    state, reply = drive_object(block, state, (30.0, 20.0, 0.0))
    assert (reply.model, state.condition) == ("M1-2", "IN")


def points_all_over(count=1000):
    random = np.random.default_rng(11)
    scattered = random.uniform([-10.0, -90.0, -20.0], [95.0, 40.0, 20.0], (count // 2, 3))
    walk = np.cumsum(random.normal(size=(count - count // 2, 3)) * [3.0, 3.0, 0.5], axis=0)
    return np.vstack([scattered, walk % [90.0, 120.0, 20.0] - [5.0, 85.0, 10.0]])


def settings():
    plain = loaded(vertical_block(camera=CAMERAS["ideal"], tilted=True))
    yield "automatic", *plain
    yield "not automatic", plain.block, automatic(plain.block, plain.state, False)[0]
    yield "locked", plain.block, lock(plain.block, plain.state, "RIGHT")[0]
    no_frame = replace(CAMERAS["measured"], frame=(0.0, 0.0))
    yield "no frame", *loaded(vertical_block(camera=no_frame, tilted=True))
    yield "one model", *loaded(vertical_block(rows=1, columns=1))
    yield "equals", *strips_at(0.0, 500.0, 0.0)


@pytest.mark.parametrize(
    ("block", "state"), [setting[1:] for setting in settings()], ids=[setting[0] for setting in settings()]
)
def test_many_points_are_driven_to_as_one_after_the_other(block, state):
    points = points_all_over()
    after, driven = drive_objects(block, state, points)
    for row, point in enumerate(points.tolist()):
        state, reply = drive_object(block, state, tuple(point))
        code = DriveCode.NONE if hasattr(reply, "model") else reply.code
        assert (state.model, code) == (driven.model[row], driven.code[row])
        if code == DriveCode.NONE:
            assert state.plates == (
                pytest.approx(driven.upper[row], abs=1e-9),
                pytest.approx(driven.lower[row], abs=1e-9),
            )
            assert (state.condition == "IN") == driven.inside[row]
        else:
            assert np.isnan(driven.upper[row]).all()
    assert after.model == state.model
    assert after.mark == state.mark
    assert after.plates[0] == pytest.approx(state.plates[0], abs=1e-9)


def test_no_points_change_nothing():
    block, state = loaded(vertical_block())
    after, driven = drive_objects(block, state, np.empty((0, 3)))
    assert after == state
    assert len(driven.model) == 0


def test_position_after_driving():
    block, state = loaded(vertical_block(camera=PLAIN_CAMERA, tilted=True))
    state, _ = drive_object(block, state, (33.3, 4.4, 2.2))
    found = object_position(block, state)
    assert found.xyz == pytest.approx((33.3, 4.4, 2.2), abs=1e-9)
    assert found.y_parallax == pytest.approx(0.0, abs=1e-9)
