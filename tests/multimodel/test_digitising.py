"""The order of digitising and the choice of stereo partners."""

from __future__ import annotations

from hypothesis import given, settings
from hypothesis import strategies as st

from orip.multimodel.digitising.order import DigitisedBlock, DigitisingStep, PhotoPair, Turn, from_point

PHOTOS = [f"{strip}0{number}" for strip in (1, 2) for number in (1, 2, 3, 4)]

# two strips of four photos; as on two templates, photos alternate between the stages
BLOCK = DigitisedBlock(
    tuple(
        PhotoPair(f"{strip}-{column}", f"{strip}0{column}", f"{strip}0{column + 1}", strip, column)
        for strip in (1, 2)
        for column in (1, 2, 3)
    ),
    {photo: "UPPER" if int(photo) % 2 else "LOWER" for photo in PHOTOS},
)


def steps(turn, measured=()):
    """Take a turn to its end, each photo digitised; return its steps."""
    measured, left, found = list(measured), list(turn.photos), []
    while left:
        step = BLOCK.next_step(turn._replace(photos=tuple(left)), measured)
        found.append(step)
        measured += step.photos
        left = [photo for photo in left if photo not in step.photos]
    return found


def test_a_new_point_is_measured_in_both_photos_of_a_model():
    assert steps(Turn("7", ("101", "102"), "1-1")) == [DigitisingStep(("101", "102"), None, "1-1")]


def test_within_a_strip_the_photo_that_has_the_point_is_locked():
    assert steps(Turn("7", ("103",), "1-2"), ["101", "102"]) == [DigitisingStep(("103",), "102", "1-2")]


def test_from_the_strip_beside_a_point_is_transferred_in_two_steps():
    # 101 is on the upper stage with 201, so that it is seen together with 202; from there to 201
    assert steps(Turn("7", ("201", "202"), "2-1"), ["101"]) == [
        DigitisingStep(("202",), "101", "2-1"),
        DigitisingStep(("201",), "202", "2-1"),
    ]


def test_a_side_lap_is_between_strips():
    transfer = steps(Turn("7", ("201", "202"), "2-1"), ["101"])
    assert [BLOCK.is_side_lap(step) for step in transfer] == [True, False]
    assert not BLOCK.is_side_lap(DigitisingStep(("101", "102"), None, "1-1"))
    # a photo in no model is in no strip
    assert not BLOCK.is_side_lap(DigitisingStep(("201",), "900", "2-1"))


def test_the_nearest_photo_of_the_strip_beside_is_the_partner():
    assert steps(Turn("7", ("201",), "2-1"), ["104", "102"]) == [DigitisingStep(("201",), "102", "2-1")]


def test_a_photo_on_the_same_stage_is_no_partner():
    assert steps(Turn("7", ("203",), "2-2"), ["101"]) == [DigitisingStep(("203",), None, "2-2")]


def test_a_photo_without_a_stage_is_no_partner():
    block = DigitisedBlock(BLOCK.models, {"101": "UPPER"})
    assert block.next_step(Turn("7", ("101",), "1-1"), ["102"]) == DigitisingStep(("101",), None, "1-1")


def test_measuring_again_begins_with_a_stereo_pair_and_goes_on_from_photo_to_photo():
    assert steps(Turn("7", ("101", "102", "103", "201", "202"))) == [
        DigitisingStep(("101", "102"), None, "1-1"),
        DigitisingStep(("103",), "102", "1-2"),
        DigitisingStep(("202",), "101", "2-1"),
        DigitisingStep(("201",), "202", "2-1"),
    ]


def test_a_single_point_that_is_measured_again_finds_its_partner():
    assert steps(Turn("7", ("102",)), ["101", "103"]) == [DigitisingStep(("102",), "101", "1-1")]


def test_new_points_come_model_by_model():
    wanted = {"1": ["101", "102", "103"], "2": ["102", "103"], "3": ["101"], "4": ["202", "201"]}
    assert list(BLOCK.turns_by_model(wanted, {})) == [
        Turn("1", ("101", "102"), "1-1"),
        Turn("3", ("101",), "1-1"),
        Turn("1", ("103",), "1-2"),
        Turn("2", ("102", "103"), "1-2"),
        Turn("4", ("201", "202"), "2-1"),
    ]


def test_a_photo_waits_for_the_model_in_which_it_has_a_partner():
    wanted, measured = {"1": ["102"]}, {"1": ["103"]}
    assert list(BLOCK.turns_by_model(wanted, measured)) == [Turn("1", ("102",), "1-2")]


def test_points_that_are_measured_again_come_point_by_point():
    wanted = {"2": ["203", "101", "102"], "1": ["104"]}
    assert list(BLOCK.turns_by_point(wanted)) == [Turn("2", ("101", "102", "203")), Turn("1", ("104",))]


def test_with_one_eye_points_come_photo_by_photo():
    wanted = {"1": ["999", "102"], "2": ["101", "102"]}
    assert list(BLOCK.turns_by_photo(wanted)) == [
        Turn("2", ("101",)), Turn("1", ("102",)), Turn("2", ("102",)), Turn("1", ("999",)),
    ]  # fmt: skip


def test_beginning_with_a_point():
    turns = [Turn("1", ("101",)), Turn("2", ("101",)), Turn("1", ("102",))]
    assert from_point(turns, "2") == turns[1:]
    assert from_point(turns, "1") == turns
    assert from_point(turns, "3") is None


photo_sets = st.sets(st.sampled_from(PHOTOS))


@settings(max_examples=200, deadline=None)
@given(wanted=st.dictionaries(st.sampled_from("abc"), photo_sets), others=photo_sets)
def test_every_photo_has_its_turn_once_and_partners_are_what_partners_are(wanted, others):
    wanted = {point: sorted(photos) for point, photos in wanted.items()}
    measured = {point: sorted(others - set(photos)) for point, photos in wanted.items()}
    models = {model.model: set(model.photos) for model in BLOCK.models}
    for turns in (BLOCK.turns_by_model(wanted, measured), BLOCK.turns_by_point(wanted), BLOCK.turns_by_photo(wanted)):
        have = {point: set(photos) for point, photos in measured.items()}
        visited = []
        for turn in turns:
            for step in steps(turn, sorted(have[turn.point])):
                visited += [(turn.point, photo) for photo in step.photos]
                if step.partner is not None:
                    (photo,) = step.photos
                    assert step.partner in have[turn.point]
                    assert BLOCK.stages[step.partner] != BLOCK.stages[photo]
                    assert photo in models[step.model]
                if len(step.photos) == 2:
                    assert set(step.photos) == models[step.model]
                have[turn.point].update(step.photos)
        assert sorted(visited) == sorted((point, photo) for point, photos in wanted.items() for photo in photos)
