"""The commands of the plate processor: what moves, what stays, and what is refused with which code."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.drive_tables import LIMITS, C, cameras, loaded, vertical_block

from orip.multimodel.movement import (
    automatic,
    change_model,
    drive_model,
    drive_object,
    drive_photo,
    drive_plate,
    foot,
    forward,
    guide,
    guide_named,
    key,
    lock,
    move,
    next_event,
    next_model,
    prism,
)
from orip.multimodel.readout import (
    MOST_PROFILE_POINTS,
    model_position,
    object_position,
    photo_positions,
    plate_position,
    profile,
    status,
    which,
)
from orip.multimodel.state import MOST_EVENTS
from orip.records.drive_table import DriveCode, DriveFault, StageLimits
from orip.structs import replace

TILTED = loaded(vertical_block(camera=cameras()["measured"], tilted=True))
LEVEL_BLOCK = loaded(vertical_block())


@pytest.fixture
def at_start():
    return loaded(vertical_block())


def on_plate(block, name, xf, yf):
    return pytest.approx(block.photo(name).plate_of_photo(xf, yf), abs=1e-9)


def refused(outcome, before, code):
    """Check that nothing has changed, and why; return the sentence."""
    after, reply = outcome
    assert after == before
    assert isinstance(reply, DriveFault)
    assert reply.code == code
    return reply.text


def test_the_first_model_begins_at_start(at_start):
    block, state = at_start
    # START is (10, 0, 0): 5 mm beside both photos' middles
    assert status(block, state) == ("M1-1", "OBJECT", "IN", None, (0, 0), True)
    assert state.plates == (on_plate(block, "P1-1", 5.0, 0.0), on_plate(block, "P1-2", -5.0, 0.0))


def test_a_start_that_cannot_be_driven_to_leaves_the_stages_in_the_middle():
    _, state = loaded(replace(vertical_block(), start=(0.0, 0.0, 1e6)))
    assert (state.plates, state.mark, state.condition) == (((120.0, 120.0), (120.0, 120.0)), None, "OUTSIDE")


def test_optics_are_swapped_where_the_left_photo_is_on_the_lower_stage(at_start):
    block, state = at_start
    state, reply = drive_object(block, state, (30.0, 0.0, 0.0))
    assert reply.model == "M1-2"
    assert block.models[state.model].swapped
    # left photo P1-2 is on the lower stage
    assert state.plates == (on_plate(block, "P1-3", -5.0, 0.0), on_plate(block, "P1-2", 5.0, 0.0))
    assert [position.photo for position in photo_positions(block, state)] == ["P1-2", "P1-3"]
    assert [position.xy for position in photo_positions(block, state)] == [
        pytest.approx(xy) for xy in ((5.0, 0.0), (-5.0, 0.0))
    ]
    assert object_position(block, state).xyz == pytest.approx((30.0, 0.0, 0.0), abs=1e-9)


def test_read_out_is_rounded_to_the_least_count_and_movement_is_not():
    coarse = StageLimits(0.0, 240.0, 0.0, 240.0, 0.5)
    block, state = loaded(replace(vertical_block(), upper=coarse))
    state, _ = guide(block, state, "UPPER")
    (x, y), _ = state.plates
    for _ in range(10):
        state, reply = move(block, state, (0.1, 0.0))
    assert state.plates[0] == pytest.approx((x + 1.0, y), abs=1e-12)
    assert reply.upper == plate_position(block, state)[0] == (round((x + 1.0) * 2.0) / 2.0, round(y * 2.0) / 2.0)
    assert reply.lower == pytest.approx(state.plates[1], abs=5e-4)


@pytest.mark.parametrize(
    ("words", "system"),
    [
        (("1", "u", "UPPER"), "UPPER"),
        (("2", "L", "lower"), "LOWER"),
        (("3", "b", "Both"), "BOTH"),
        (("4", "m", "MODEL"), "MODEL"),
        (("5", "O", "object"), "OBJECT"),
        (("0", "6", "x", "", "UP", "12"), None),
    ],
)
def test_guiding_systems_by_number_letter_or_name(words, system):
    assert [guide_named(word) for word in words] == [system] * len(words)


@pytest.mark.parametrize(("system", "moved"), [("UPPER", (1, 0)), ("LOWER", (0, 1)), ("BOTH", (1, 1))])
def test_plate_guiding(at_start, system, moved):
    block, state = at_start
    state, _ = guide(block, state, system)
    after, _ = move(block, state, (1.0, -2.0))
    for before, now, factor in zip(state.plates, after.plates, moved, strict=True):
        assert now == pytest.approx((before[0] + factor, before[1] - 2.0 * factor), abs=1e-12)
    refused(move(block, state, (1.0, 2.0, 3.0)), state, DriveCode.WRONG_GUIDE)


def test_plate_guiding_never_changes_the_model(at_start):
    block, state = at_start
    state, _ = guide(block, state, "BOTH")
    after, reply = move(block, state, (12.0, 0.0))
    assert (reply.model, after.condition) == ("M1-1", "OUTSIDE")
    back, _ = move(block, after, (-12.0, 0.0))
    assert back.condition == "IN"


def test_model_guiding_moves_along_the_model_axes():
    block, state = loaded(vertical_block(tilted=True))
    state, _ = guide(block, state, "MODEL")
    before = model_position(block, state).xyz
    after, _ = move(block, state, (0.5, -0.25, 2.0))
    assert model_position(block, after).xyz == pytest.approx(np.add(before, (0.5, -0.25, 2.0)), abs=1e-9)
    driven, _ = drive_model(block, state, tuple(np.add(before, (0.5, -0.25, 2.0))))
    assert driven.plates[0] == pytest.approx(after.plates[0], abs=1e-9)


def test_object_guiding_goes_on_from_where_the_rays_meet_after_a_plate_was_moved(at_start):
    block, state = at_start
    # the right photo 0.2 mm to the left: x-parallax 10.2 mm instead of 10
    state, _ = drive_photo(block, state, "P1-2", (-5.2, 0.0))
    found = object_position(block, state)
    assert found.xyz[2] == pytest.approx(100.0 - 20.0 * C / 10.2, abs=1e-9)
    after, _ = move(block, state, (0.0, 1.0, 0.0))
    assert object_position(block, after).xyz == pytest.approx(np.add(found.xyz, (0.0, 1.0, 0.0)), abs=1e-9)


def test_crossing_the_line_by_wheel(at_start):
    block, state = at_start
    models = []
    for _ in range(30):
        state, reply = move(block, state, (1.0, 0.0))
        models.append(reply.model)
    assert models == ["M1-1"] * 10 + ["M1-2"] * 20 or models == ["M1-1"] * 9 + ["M1-2"] * 20 + ["M1-3"]
    assert object_position(block, state).xyz == pytest.approx((40.0, 0.0, 0.0), abs=1e-9)


def test_without_automatic_switching_the_model_stays(at_start):
    block, state = at_start
    state, reply = automatic(block, state, False)
    assert not reply.automatic
    after, reply = drive_object(block, state, (21.0, 0.0, 0.0))
    assert (reply.model, after.condition) == ("M1-1", "OUTSIDE")
    assert which(block, after, (21.0, 0.0, 0.0)) == "M1-2"


def test_which_model_without_moving(at_start):
    block, state = at_start
    assert which(block, state, (10.0, 0.0, 0.0)) == "M1-1"
    assert which(block, state, (70.0, -40.0, 0.0)) == "M2-4"
    assert which(block, state, (70.0, 400.0, 0.0)) is None


def test_next_model_goes_through_rows_and_columns_and_begins_again():
    table = vertical_block(rows=2, columns=3)
    # without model 1-2: missing numbers are skipped
    block, state = loaded(replace(table, models=table.models[:1] + table.models[2:]))
    names = []
    for _ in range(6):
        state, reply = next_model(block, state)
        names.append(reply.model)
    assert names == ["M1-3", "M2-1", "M2-2", "M2-3", "M1-1", "M1-3"]


def test_changing_the_model_keeps_the_place(at_start):
    block, state = at_start
    state, _ = drive_object(block, state, (19.0, -5.0, 1.0))
    after, reply = change_model(block, state, "m1-2")
    assert (reply.model, after.condition) == ("M1-2", "OUTSIDE")
    assert object_position(block, after).xyz == pytest.approx((19.0, -5.0, 1.0), abs=1e-9)
    refused(change_model(block, state, "M9-9"), state, DriveCode.UNKNOWN_MODEL)


def test_changing_to_a_model_that_cannot_be_driven_there_leaves_the_plates():
    block, state = loaded(replace(vertical_block(), upper=replace(LIMITS, y_max=110.0)))
    after, reply = change_model(block, state, "M2-1")
    # 48 m from its middle, 24 mm beyond y = 100 mm on the upper plate
    assert (reply.model, after.condition, after.plates) == ("M2-1", "OUTSIDE", state.plates)
    again, reply = drive_object(block, after, after.mark)
    assert (reply.model, again.condition) == ("M1-1", "IN")


def test_driving_to_photo_coordinates_of_any_photo(at_start):
    block, state = at_start
    after, reply = drive_photo(block, state, "p2-5", (1.0, 2.0))
    assert reply.model == "M1-1"
    assert after.plates == (on_plate(block, "P2-5", 1.0, 2.0), state.plates[1])
    refused(drive_photo(block, state, "P9-9", (0.0, 0.0)), state, DriveCode.UNKNOWN_PHOTO)


def test_a_locked_plate_stays(at_start):
    block, state = at_start
    state, reply = lock(block, state, "LEFT")
    assert (reply.lock, state.locked) == ("LEFT", "UPPER")
    refused(drive_plate(block, state, "UPPER", (50.0, 60.0)), state, DriveCode.LOCKED)
    refused(drive_photo(block, state, "P2-1", (0.0, 0.0)), state, DriveCode.LOCKED)
    refused(forward(block, state), state, DriveCode.LOCKED)
    for system in ("UPPER", "BOTH"):
        guided, _ = guide(block, state, system)
        refused(move(block, guided, (1.0, 1.0)), guided, DriveCode.LOCKED)
    after, _ = drive_object(block, state, (12.0, 1.0, 3.0))
    assert after.plates[0] == state.plates[0]
    assert after.plates[1] == on_plate(block, "P1-2", *np.array([-8.0, 1.0]) * C / 97.0)
    # no change of model either, or another photo would be on the locked plate
    after, reply = drive_object(block, state, (22.0, 0.0, 0.0))
    assert reply.model == "M1-1"


def test_point_transfer_from_the_strip_beside(at_start):
    """A point of photo 1-1 is locked; model 2-1 is called, and its lower photo is moved until the point is seen."""
    block, state = at_start
    point = (10.0, -24.0, 0.0)
    state, _ = drive_photo(block, state, "P1-1", (5.0, -12.0))
    state, _ = lock(block, state, "LEFT")
    kept = state.plates[0]
    state, reply = change_model(block, state, "M2-1")
    assert (reply.model, state.locked, state.plates[0]) == ("M2-1", "UPPER", kept)
    state, _ = drive_object(block, state, point)
    assert state.plates == (kept, on_plate(block, "P2-2", -5.0, 12.0))
    assert status(block, state).lock == "LEFT"
    # in a model with swapped optics the upper plate carries the right photo
    swapped, _ = change_model(block, state, "M2-2")
    assert status(block, swapped).lock == "RIGHT"


def test_after_unlocking_nothing_jumps(at_start):
    block, state = at_start
    state, _ = lock(block, state, "LEFT")
    state, _ = drive_object(block, state, (11.0, 0.0, 0.0))
    state, _ = lock(block, state, None)
    meeting = object_position(block, state).xyz
    after, _ = move(block, state, (0.0, 0.0, 0.0))
    assert object_position(block, after).xyz == pytest.approx(meeting, abs=1e-9)
    assert after.plates[0] == pytest.approx(state.plates[0], abs=1e-9)


def test_prisms_change_no_coordinate(at_start):
    block, state = at_start
    after, reply = prism(block, state, "BOTH", 90)
    assert reply.prisms == (90, 90)
    assert after.plates == state.plates
    after, reply = prism(block, after, "RIGHT", 0)
    assert reply.prisms == (90, 0)
    after, reply = prism(block, after, "LEFT", 0)
    assert reply.prisms == (0, 0)
    refused(prism(block, state, "LEFT", 45), state, DriveCode.BAD_KEYWORD)


def test_foot_switches_and_keys_are_queued(at_start):
    block, state = at_start
    state, _ = foot(block, state, "RIGHT")
    plates = plate_position(block, state)
    state, _ = drive_object(block, state, (12.0, 0.0, 0.0))
    state, _ = foot(block, state, "LEFT")
    state, _ = key(block, state, "15")
    state, _ = key(block, state, "enter")
    events = []
    for _ in range(5):
        state, event = next_event(state)
        events.append(event)
    assert events == [("RIGHT", "", plates), ("LEFT", "", None), ("KEY", "15", None), ("KEY", "ENTER", None), None]
    for name in ("16", "-1", "", "01", "RETURN"):
        refused(key(block, state, name), state, DriveCode.BAD_KEYWORD)


def test_events_that_nobody_asks_for_do_not_pile_up(at_start):
    block, state = at_start
    for number in range(MOST_EVENTS + 5):
        state, _ = key(block, state, str(number % 16))
    assert len(state.events) == MOST_EVENTS
    assert state.events[0].key == "5"


def test_plates_to_the_front(at_start):
    block, state = at_start
    after, reply = forward(block, state)
    assert (reply.upper, reply.lower, after.condition) == ((120.0, 0.0), (120.0, 0.0), "LIMIT")
    again, _ = move(block, after, (1.0, 0.0))
    assert again.condition == "IN"
    assert object_position(block, again).xyz == pytest.approx((11.0, 0.0, 0.0), abs=1e-9)


def test_what_cannot_be_driven_moves_nothing(at_start):
    block, state = at_start
    assert "photo P1-1" in refused(drive_object(block, state, (0.0, 0.0, 200.0)), state, DriveCode.BEHIND_CAMERA)
    assert "UPPER stage" in refused(drive_object(block, state, (-200.0, 0.0, 0.0)), state, DriveCode.OUTSIDE_STAGE)
    refused(drive_plate(block, state, "LOWER", (240.001, 0.0)), state, DriveCode.OUTSIDE_STAGE)
    refused(drive_photo(block, state, "P1-1", (1000.0, 0.0)), state, DriveCode.OUTSIDE_STAGE)
    both, _ = guide(block, state, "BOTH")
    refused(move(block, both, (0.0, 500.0)), both, DriveCode.OUTSIDE_STAGE)
    assert drive_plate(block, state, "LOWER", (240.0, 0.0))[1].lower == (240.0, 0.0)


def test_beyond_the_lens():
    table = vertical_block()
    camera = replace(table.cameras[0], parameters=(50.0, 0.0, 0.0, 0.0, -1.0 / 1200.0, *(0.0,) * 7))
    block, state = loaded(replace(table, cameras=(camera,)))
    refused(drive_object(block, state, (10.0, 45.0, 0.0)), state, DriveCode.NOT_INVERTIBLE)
    # the lens shows nothing farther out than 40/3 mm
    odd, _ = drive_photo(block, state, "P1-1", (13.5, 0.0))
    assert object_position(block, odd).code == DriveCode.NOT_INVERTIBLE
    assert model_position(block, odd).code == DriveCode.NOT_INVERTIBLE


def test_rays_that_do_not_meet_have_no_position(at_start):
    block, state = at_start
    parallel, _ = drive_photo(block, state, "P1-2", (5.0, 0.0))
    assert object_position(block, parallel).code == DriveCode.PARALLEL_RAYS
    refused(move(block, parallel, (1.0, 0.0)), parallel, DriveCode.PARALLEL_RAYS)
    parting, _ = drive_photo(block, state, "P1-2", (6.0, 0.0))
    assert object_position(block, parting).code == DriveCode.BEHIND_CAMERA
    # calling another model is possible all the same
    after, reply = next_model(block, parallel)
    assert (reply.model, after.plates) == ("M1-2", parallel.plates)


def test_profile(at_start):
    block, state = at_start
    after, driven = profile(block, state, (1.0, 0.0, 0.0), (41.0, 0.0, 3.0), 0.5)
    length = np.hypot(40.0, 3.0)
    assert len(driven.model) == int(np.ceil(length / 0.5)) + 1
    assert driven.xyz[0] == pytest.approx((1.0, 0.0, 0.0))
    assert driven.xyz[-1] == pytest.approx((41.0, 0.0, 3.0), abs=1e-12)
    steps = np.linalg.norm(np.diff(driven.xyz, axis=0), axis=1)
    assert steps[:-1] == pytest.approx(0.5, abs=1e-12)
    assert 0.0 < steps[-1] <= 0.5
    assert after.mark == pytest.approx((41.0, 0.0, 3.0), abs=1e-12)
    assert block.models[after.model].name == "M1-3"


def test_profile_of_whole_steps_has_no_short_last_one(at_start):
    block, state = at_start
    _, driven = profile(block, state, (1.0, 0.0, 0.0), (2.0, 0.0, 0.0), 0.1)
    assert len(driven.model) == 11
    _, driven = profile(block, state, (1.0, 0.0, 0.0), (1.0, 0.0, 0.0), 0.1)
    assert len(driven.model) == 1


def test_profiles_that_are_refused(at_start):
    block, state = at_start
    for step in (0.0, -1.0, 10.0 / MOST_PROFILE_POINTS):
        refused(profile(block, state, (0.0, 0.0, 0.0), (10.0, 0.0, 0.0), step), state, DriveCode.BAD_KEYWORD)


number = st.floats(allow_nan=False, allow_infinity=False) | st.floats(-100.0, 250.0)
triple = st.tuples(number, number, number)
pair = st.tuples(number, number)
photo_names = st.sampled_from(["P1-1", "p2-3", "P1-2", "NONE"])
commands = st.one_of(
    st.tuples(st.just(drive_object), triple),
    st.tuples(st.just(drive_model), triple),
    st.tuples(st.just(drive_plate), st.sampled_from(["UPPER", "LOWER"]), pair),
    st.tuples(st.just(drive_photo), photo_names, pair),
    st.tuples(st.just(move), pair | triple),
    st.tuples(st.just(guide), st.sampled_from(["UPPER", "LOWER", "BOTH", "MODEL", "OBJECT"])),
    st.tuples(st.just(lock), st.sampled_from(["LEFT", "RIGHT", None])),
    st.tuples(st.just(automatic), st.booleans()),
    st.tuples(st.just(change_model), st.sampled_from(["M1-1", "M2-4", "m1-2", "NONE"])),
    st.tuples(st.just(next_model)),
    st.tuples(st.just(forward)),
    st.tuples(st.just(foot), st.sampled_from(["LEFT", "RIGHT"])),
    st.tuples(st.just(profile), triple, triple, number),
)


@given(st.lists(commands, max_size=12), st.booleans())
@settings(max_examples=200, deadline=None)
def test_any_commands_leave_the_plates_where_they_may_be(given_commands, tilted):
    block, state = TILTED if tilted else LEVEL_BLOCK
    for command, *arguments in given_commands:
        before = state
        state, reply = command(block, before, *arguments)
        if isinstance(reply, DriveFault):
            assert state == before
            assert reply.code != DriveCode.NONE
            assert reply.text
        if before.locked is not None:
            assert state.plate(before.locked) == before.plate(before.locked)
        for position in state.plates:
            assert all(0.0 <= coordinate <= 240.0 for coordinate in position)
        for read in (status, object_position, model_position, plate_position, photo_positions):
            read(block, state)
        which(block, state, (10.0, 10.0, 10.0))
