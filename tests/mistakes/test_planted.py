"""Mistakes planted in blocks with known truth: the first line names them, and accuses nothing else."""

from __future__ import annotations

from itertools import groupby
from operator import itemgetter

import pytest
from mistakes.planted.blocks import SCENES, planted_block
from mistakes.planted.study import Case, cases, outcome, said_of
from support.long_cases import every, with_long

FIXED = [
    ("one_photo_y_mirrored", "strip"),
    ("one_photo_x_mirrored", "flat strip"),
    ("one_photo_x_for_y", "two strips given"),
    ("one_photo_x_for_y", "object"),
    ("all_photos_y_mirrored", "two strips"),
    ("two_photos_exchanged", "two strips given"),
    ("two_photos_exchanged", "object given"),
    ("same_photo_twice", "object"),
    ("one_photo_of_another_lens", "two strips"),
    ("points_shifted_by_a_line", "two strips"),
    ("micrometres", "strip"),
    ("tenth_of_micrometres", "test field"),
    ("micrometres_without_frame", "pair"),
    ("pixels_as_millimetres", "facade"),
    ("precision_in_metres", "strip"),
    ("kappa_turned", "strip given"),
    ("kappa_turned", "facade given"),
    ("slip_in_a_centre", "two strips given"),
    ("centre_with_x_for_y", "strip given"),
    ("one_photo_x_mirrored", "flat strip given"),
    ("one_photo_x_for_y", "strip given"),
    ("north_east", "pair"),
    ("north_east", "pair given"),
    ("north_east", "facade given"),
    ("north_east", "flat strip"),
    ("heights_downwards", "pair"),
    ("heights_in_feet", "two strips"),
    ("two_control_points_exchanged", "two strips"),
    ("height_off_by_a_little", "two strips"),
    ("check_point_far_off", "strip"),
    ("two_check_points_exchanged", "object"),
    ("one_number_for_two_points", "two strips"),
    ("two_numbers_for_one_point", "two strips"),
    ("another_number_in_a_photo", "object"),
    ("wrong_distance", "facade"),
    ("distance_to_another_point", "object"),
]
"""Mistakes of each kind, in blocks that are adjusted in an instant; the ordinary suite takes each kind once."""
LONG = [("half_resolution", "object")]

NAMED, WRONG = 0.85, 0.02
"""Part of the mistakes that show which has to be named at once, and part that may be taken for something else."""


@pytest.mark.parametrize(
    ("mistake", "scene"),
    [case for _, of_kind in groupby(sorted(FIXED, key=itemgetter(0)), itemgetter(0)) for case in every(4, of_kind)]
    + with_long(LONG, LONG),
)
def test_a_planted_mistake_is_named_at_once(mistake: str, scene: str) -> None:
    found = outcome(Case(scene, 0, mistake))
    assert found.verdict == "named", found.said[:2]


@pytest.mark.parametrize("scene", SCENES)
def test_of_a_sound_block_nothing_is_said(scene: str) -> None:
    assert said_of(planted_block(scene, 0)) == ((), False)


@pytest.mark.long
@pytest.mark.timeout(7200)
def test_most_mistakes_that_show_are_named_and_hardly_anything_else_is_accused() -> None:
    found = [outcome(case) for case in cases()]
    shown = [outcome for outcome in found if outcome.shows]
    assert len(shown) >= 300
    assert sum(outcome.verdict == "named" for outcome in shown) >= NAMED * len(shown)
    wrong = [str(outcome.case) for outcome in found if outcome.verdict == "wrong"]
    assert len(wrong) <= WRONG * len(found), wrong
